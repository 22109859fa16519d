"""Results of controllers as rows of text."""

import math
from collections.abc import Callable, Sequence

from ballbot_rs.analysis.episodes import Result

#: Columns of a printed line.
WIDTH = 100

_COLUMNS: dict[str, Callable[[Result], str]] = {
    "controller": lambda r: r.controller,
    "rate (Hz)": lambda r: f"{1 / r.control_dt:.0f}",
    "success": lambda r: f"{100 * r.success_rate:.0f} %",
    "upright": lambda r: f"{100 * r.survival_rate:.0f} %",
    "settling (s)": lambda r: "never" if r.settling_time is None else f"{r.settling_time:.2f}",
    "tilt (deg)": lambda r: f"{math.degrees(r.tilt_rms):.2f}",
    "ball (m)": lambda r: f"{r.ball_excursion:.3f}",
    "torque (N·m)": lambda r: f"{r.torque_rms:.3f}",
    "reward": lambda r: f"{r.mean_reward:.3f}",
}


LEGEND = """\
Upright: to the end of the episode. Settling: median time from which the tilt stays within 1 deg.
Tilt, torque: root mean square over all steps to the end or the fall. Reward: mean of a step.
Ball: largest distance from the setpoint, mean over episodes."""


def rows(results: Sequence[Result]) -> list[list[str]]:
    """The header, and one row a controller."""
    return [list(_COLUMNS), *([cell(result) for cell in _COLUMNS.values()] for result in results)]


def print_table(results: Sequence[Result]) -> None:
    """Prints one row a controller, and what the columns mean."""
    full = rows(results)
    rest = sum(max(len(row[i]) for row in full) + 2 for i in range(1, len(_COLUMNS)))
    cells = [[_shortened(row[0], WIDTH - rest), *row[1:]] for row in full]
    widths = [max(len(row[i]) for row in cells) for i in range(len(_COLUMNS))]
    for number, row in enumerate(cells):
        line = (cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True)))
        print("  ".join(line))
        if number == 0:
            print("  ".join("-" * width for width in widths))
    print(f"\n{results[0].episodes} episodes each, model {results[0].model}.\n{LEGEND}")


def _shortened(name: str, width: int) -> str:
    """A name, if need be only its end."""
    return name if len(name) <= width else f"…{name[1 - width :]}"
