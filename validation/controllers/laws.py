"""Draws docs/laws: the response of each law to a motion and a step, and the tilts from which it recovers."""

import argparse
import sys
import time
from pathlib import Path
from typing import Final

import ballbot_rs as bb
from validation.controllers import law_figure, responses
from validation.controllers.planners import PLANNERS
from validation.page import DOCS

FIGURES: Final = DOCS / "laws"
#: Laws drawn by default; `mppi` and `nmpc` take minutes.
USUAL: Final = tuple(name for name in bb.controllers() if name not in PLANNERS)


def main() -> int:
    """The command `python -m validation.controllers.laws`."""
    parser = argparse.ArgumentParser(prog="python -m validation.controllers.laws", description=__doc__)
    parser.add_argument("laws", nargs="*", metavar="LAW", help="draw these (default: all but the slow mppi and nmpc)")
    parser.add_argument("--figures", type=Path, metavar="DIR", default=FIGURES, help="where to (default: docs/laws)")
    requested = parser.parse_args()
    known = list(bb.controllers())
    if unknown := [name for name in requested.laws if name not in known]:
        parser.error(f"no law {', '.join(unknown)}; there are: {', '.join(known)}")
    for name in requested.laws or USUAL:
        began = time.perf_counter()
        path = write(name, requested.figures)
        print(f"wrote {path}, {time.perf_counter() - began:.1f} s", flush=True)
    return 0


def write(name: str, folder: Path) -> Path:
    """Writes the figure of a law into a folder, and returns its path."""
    from ballbot_rs.media.figures import panels, style

    folder.mkdir(parents=True, exist_ok=True)
    fig = style.figure(*law_figure.SIZE)
    law_figure.draw(fig, responses.measure(name))
    panels.finish(fig)
    path = folder / f"{name}.svg"
    style.save(fig, path)
    return path


if __name__ == "__main__":
    sys.exit(main())
