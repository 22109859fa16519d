"""Tunes the laws of the core with one budget for all, and writes validation/controllers/tuned.toml.

`python -m validation.controllers.tuning` takes half an hour; with names of laws it tunes these and leaves the others.
"""

import argparse
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from ballbot_rs import _toml
from ballbot_rs._core import CONTROLLERS
from ballbot_rs.scenarios.tune import DEFAULT, tune

#: Evaluations of each law, the first of the default options among them.
BUDGET: Final = 2000
SEED: Final = 0
#: Its default options have the cost 1.
BASELINE: Final = "lqr"
#: What takes too long: each decision simulates 512 motions.
LEFT_OUT: Final = ("mppi",)
PATH: Final = Path(__file__).with_name("tuned.toml")

_HEAD = f"""\
# Options that `bb.tune` found for the paper's robot: {BUDGET} evaluations of its default scenarios a law, seed {SEED}.
# Written by `python -m validation.controllers.tuning`. The cost of `{BASELINE}` with its default options is 1.
"""


class TunedLaw(NamedTuple):
    """What the search has found for a law."""

    cost: float
    options: Mapping[str, float]


@cache
def tuned() -> Mapping[str, TunedLaw]:
    """What the file has, by law."""
    tables: Mapping[str, Any] = _toml.loads(PATH.read_text(encoding="utf-8")) if PATH.exists() else {}
    return {name: TunedLaw(table["cost"], table["options"]) for name, table in tables.items()}


def write(found: Mapping[str, TunedLaw]) -> None:
    """Writes the file, the laws in the order of the core."""
    parts = [_HEAD]
    for name in CONTROLLERS:
        if name in found:
            options = "".join(f"{option} = {value!r}\n" for option, value in found[name].options.items())
            parts.append(f"[{name}]\ncost = {found[name].cost!r}\n[{name}.options]\n{options}")
    PATH.write_text("\n".join(parts), encoding="utf-8")


def main() -> int:
    """The command."""
    laws = [name for name in CONTROLLERS if name not in LEFT_OUT]
    parser = argparse.ArgumentParser(prog="python -m validation.controllers.tuning", description=__doc__)
    parser.add_argument("laws", nargs="*", metavar="LAW", help=f"some of {', '.join(laws)}; all without")
    parser.add_argument("--threads", type=int, default=1, help="that step the robots (%(default)s)")
    asked = parser.parse_args()
    if unknown := [name for name in asked.laws if name not in laws]:
        parser.error(f"no law {', '.join(unknown)} to tune; there are: {', '.join(laws)}")
    for name in asked.laws or laws:
        found = tune(name, DEFAULT, BUDGET, baseline=BASELINE, seed=SEED, num_threads=asked.threads)
        tuned.cache_clear()
        write({**tuned(), name: TunedLaw(found.cost, found.options)})
        print(f"{name}: cost {found.cost:.3f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
