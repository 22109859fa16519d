"""Labels of controllers in figures."""

import textwrap
from pathlib import Path

from ballbot_rs._core import CONTROLLERS
from ballbot_rs.control.resolve import NAMES

#: Letters of a title per inch.
LETTERS = 10


def short(controller: str) -> str:
    """A name that fits above a figure: the folder of a run, the file of a policy."""
    if controller in NAMES:
        return str(CONTROLLERS[controller]["label"]) if controller in CONTROLLERS else "no torque"
    path = Path(controller)
    return path.resolve().parent.name if path.stem in ("best_model", "final_model") else path.name


def title(controller: str, model: str, inches: float, *more: str) -> str:
    """Lines above a panel of a width: controller, model and more; long names are wrapped."""
    letters = max(int(LETTERS * inches), 8)
    lines = textwrap.wrap(f"{short(controller)} on {model}", letters, break_on_hyphens=True)
    return "\n".join([*lines, *more])
