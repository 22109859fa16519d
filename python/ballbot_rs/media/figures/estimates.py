"""True and estimated states of robots over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import title
from ballbot_rs.media.figures.marks import mark_events
from ballbot_rs.media.figures.panels import LINES, letter
from ballbot_rs.media.figures.style import COLORS, columns, legends

#: From top to bottom: label, attribute of the state, factor of its unit.
QUANTITIES = (
    ("tilt (deg)", "tilt_components", np.degrees(1.0)),
    ("ball velocity (m/s)", "ball_velocity", 1.0),
    ("ball position (m)", "ball_position", 1.0),
)
#: The same for the distance between estimate and true state.
ERRORS = (
    ("tilt error (deg)", "tilt_components", np.degrees(1.0)),
    ("position error (mm)", "ball_position", 1e3),
)


def draw(trajectories: Sequence[Trajectory], width: float | None = None) -> Figure:
    """One column per controller, one row per quantity; up to a fall.

    Args:
        trajectories: the trajectories to show.
        width: of the figure, inches; None is as wide as its columns need.

    Raises:
        ValueError: a trajectory without estimates, or a width out of range or too narrow for so many controllers.
    """
    for trajectory in trajectories:
        if not trajectory.estimates:
            raise ValueError(
                f"the trajectory of {trajectory.controller} has no estimates: its task observes no sensors"
            )
    rows = len(QUANTITIES) + len(ERRORS)
    fig, axes, each = columns(rows, len(trajectories), width)
    for column, trajectory in zip(axes.T, trajectories, strict=True):
        _draw_column(column, trajectory)
        column[0].set_title(title(trajectory.controller, trajectory.model, each), pad=16)
    for ax, (label, _, _) in zip(axes[:, 0], (*QUANTITIES, *ERRORS), strict=True):
        ax.set_ylabel(label)
    for ax in axes[len(QUANTITIES) :, 0]:
        ax.set_ylim(bottom=0.0)
    legends(fig, axes[: len(QUANTITIES), -1])
    letter(axes.ravel())
    fig.align_ylabels(axes[:, 0])
    return fig


def errors(trajectory: Trajectory, name: str) -> Any:
    """Horizontal distance between estimate and true state, or between their tilts, at each row, shape (n,)."""
    true = trajectory.of_states(name)[: len(trajectory.estimates), :2]
    return np.linalg.norm(trajectory.of_estimates(name)[:, :2] - true, axis=1)


def _draw_column(axes: Sequence[Any], trajectory: Trajectory) -> None:
    times = trajectory.times[: len(trajectory.estimates)]
    for ax, (_, name, factor) in zip(axes, QUANTITIES, strict=False):
        true, estimated = trajectory.of_states(name) * factor, trajectory.of_estimates(name) * factor
        for i, axis in enumerate("xy"):
            # The estimate hides nothing: the true state is wide and pale below it.
            color = COLORS[i]
            ax.plot(times, true[: len(times), i], color=color, linewidth=3.0, alpha=0.35, label=f"{axis}, true")
            dashes: dict[str, Any] = {"color": color, "linestyle": LINES[1 + i], "linewidth": 1.0}
            ax.plot(times, estimated[:, i], label=f"{axis}, estimated", **dashes)
    for ax, (_, name, factor) in zip(axes[len(QUANTITIES) :], ERRORS, strict=True):
        ax.plot(times, errors(trajectory, name) * factor, color=COLORS[0])
    mark_events(axes, trajectory)
    axes[-1].set_xlabel("time (s)")
