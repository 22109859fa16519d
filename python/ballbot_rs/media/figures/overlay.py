"""Several controllers in common axes: tilt, ball position and the wheels' extremes over time."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.marks import mark_events, mark_limit
from ballbot_rs.media.figures.panels import letter, look
from ballbot_rs.media.figures.style import FULL_WIDTH, below, figure

#: Labels of the panels, by rows of two.
QUANTITIES: Final = (
    *("tilt about x (deg)", "tilt about y (deg)"),
    *("ball x (m)", "ball y (m)"),
    *("largest wheel\ntorque (N\u00b7m)", "largest friction\nused (%)"),
)


def draw(trajectories: Sequence[Trajectory], width: float | None = None) -> Figure:
    """One curve per controller in each panel; of torques and friction the largest of the contacts.

    Args:
        trajectories: of the same scenario; its pushes and forces are marked as in the first.
        width: of the figure, inches; None is 7.2, the width of a page.

    Raises:
        ValueError: a width out of range.
    """
    wide = 7.2 if width is None else width
    rows, across = (3, 2) if wide >= FULL_WIDTH else (6, 1)
    fig = figure(wide, 1.6 * rows + 0.5 if across == 2 else 1.15 * rows + 0.7)
    axes = fig.subplots(rows, across, sharex=True).ravel()
    for number, trajectory in enumerate(trajectories):
        style: dict[str, Any] = {"linewidth": 1.2, **look(number)}
        for ax, values in zip(axes, _values(trajectory), strict=True):
            ax.plot(trajectory.times, values, **style)
    for ax, label in zip(axes, QUANTITIES, strict=True):
        ax.set_ylabel(label)
        ax.margins(x=0.02)
    limits = {one.max_wheel_torque for one in trajectories}
    limit = limits.pop() if len(limits) == 1 else None
    if limit is not None:
        mark_limit(axes[4], limit, f"limit {limit:.3g} N\u00b7m", both=False)
    mark_limit(axes[5], 100.0, "limit", both=False)
    for ax in axes[4:]:
        ax.set_ylim(bottom=0.0)
    mark_events(axes, trajectories[0])
    for ax in axes[-across:]:
        ax.set_xlabel("time (s)")
    letter(axes)
    fig.align_ylabels(axes)
    keys = [
        Line2D([], [], label=f"{short(one.controller)} on {one.model}{_end(one)}", **look(number))
        for number, one in enumerate(trajectories)
    ]
    below(fig, keys, 4)
    return fig


def _values(trajectory: Trajectory) -> list[Any]:
    tilts, positions = trajectory.of_states("tilt_components"), trajectory.of_states("ball_position")
    friction = 100.0 * trajectory.of_contacts("friction_utilization").max(axis=1)
    # Models with contacts have no forces before their first step.
    friction[0] = np.nan
    torques = np.abs(trajectory.torques).max(axis=1)
    return [*np.degrees(tilts[:, :2].T), *positions[:, :2].T, torques, friction]


def _end(trajectory: Trajectory) -> str:
    return "" if trajectory.fell_at is None else f", fell at {trajectory.fell_at:.2f} s"
