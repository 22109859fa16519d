"""Marks on curves over time: pushes, forces, falls, limits."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.style import COLORS, INK

#: Colors of pushes and falls, different from all curves.
PUSH, FELL, LIMIT = COLORS[6], INK, COLORS[6]
#: A limit is shown if the curves come within this fraction of it.
NEAR = 0.4
#: Most pushes with names.
NAMED = 3


def mark_events(axes: Sequence[Any], trajectory: Trajectory) -> None:
    """Lines through all axes at pushes and at a fall, bands during forces; the first axis names them."""
    named = []
    pushes = trajectory.all_pushes
    for push in pushes:
        # Names of many pushes would not fit.
        name = f"push {np.linalg.norm(push.impulse):.3g} N\u00b7s" if len(pushes) <= NAMED else ""
        named.append((push.time, name, PUSH))
        if push.duration > 0.0:
            _band(axes, push.time, push.time + push.duration)
    for force in trajectory.forces:
        end = float(trajectory.times[-1]) if force.end is None else force.end
        named.append((force.begin, f"force {np.linalg.norm(force.force):.3g} N", PUSH))
        _band(axes, force.begin, end)
    if trajectory.fell_at is not None:
        named.append((trajectory.fell_at, "motors off", FELL))
    for time, text, color in named:
        for ax in axes:
            ax.axvline(time, color=color, linestyle=":", linewidth=1.0, zorder=1.5)
        _name(axes[0], trajectory, time, text, color)


def _band(axes: Sequence[Any], begin: float, end: float) -> None:
    for ax in axes:
        ax.axvspan(begin, end, color=PUSH, alpha=0.08, linewidth=0)


def _name(ax: Any, trajectory: Trajectory, time: float, text: str, color: str) -> None:
    # Above the axis, where there are no curves; falls, and marks near the right end, to the left of their lines.
    late = color == FELL or time > 0.6 * trajectory.times[-1]
    ax.annotate(
        text,
        (time, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(-2 if late else 2, 1),
        textcoords="offset points",
        ha="right" if late else "left",
        va="bottom",
        fontsize="small",
        color=color,
    )


def mark_limit(ax: Any, limit: float, label: str, both: bool = True) -> None:
    """A dashed line at a limit, and at its negative; above the axis where curves stay far below it."""
    largest = max(
        (float(np.nanmax(np.abs(line.get_ydata()))) for line in ax.lines if len(line.get_ydata())), default=0.0
    )
    if largest < NEAR * limit:
        ax.annotate(
            f"{label} (not shown)",
            (1.0, 1.0),
            xycoords="axes fraction",
            xytext=(0, 1),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize="small",
            color=LIMIT,
        )
        return
    for i, value in enumerate((limit, -limit) if both else (limit,)):
        ax.axhline(value, color=LIMIT, linestyle=(0, (6, 3)), linewidth=0.9, label="" if i else label)
