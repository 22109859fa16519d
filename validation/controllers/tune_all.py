"""Tunes the laws of the core with the same budget for all, and writes validation/controllers/tuned.toml.

`python -m validation.controllers.tune_all` takes twenty minutes; with names of laws it only tunes these.
"""

import argparse
import sys

from ballbot_rs._core import CONTROLLERS
from validation.controllers import tuning
from validation.controllers.planners import PLANNERS, YIELDING


def main() -> int:
    """The command."""
    laws = [name for name in CONTROLLERS if name not in (*PLANNERS, *YIELDING)]
    parser = argparse.ArgumentParser(prog="python -m validation.controllers.tune_all", description=__doc__)
    parser.add_argument("laws", nargs="*", metavar="LAW", help=f"some of {', '.join(laws)}; all without")
    parser.add_argument("--threads", type=int, default=1, help="that step the robots (%(default)s)")
    requested = parser.parse_args()
    if unknown := [name for name in requested.laws if name not in laws]:
        parser.error(f"no law {', '.join(unknown)} to tune; there are: {', '.join(laws)}")
    for name in requested.laws or laws:
        found = tuning.search(name, requested.threads)
        # Another process may have written the file in the meantime.
        tuning.tuned.cache_clear()
        tuning.write({**tuning.tuned(), name: found})
        print(f"{name}: cost {found.cost:.3f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
