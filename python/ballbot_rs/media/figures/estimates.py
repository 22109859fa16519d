"""True states of robots beside those that follow from their sensors, over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.style import COLORS, figure

#: From top to bottom: label, attribute of the state, factor of its unit.
QUANTITIES = (
    ("tilt (deg)", "tilt_components", np.degrees(1.0)),
    ("ball velocity (m/s)", "ball_velocity", 1.0),
    ("ball position (m)", "ball_position", 1.0),
)
#: The same for the distance of estimate and true state.
ERRORS = (
    ("tilt error (deg)", "tilt_components", np.degrees(1.0)),
    ("position error (m)", "ball_position", 1.0),
)


def draw(trajectories: Sequence[Trajectory]) -> Figure:
    """A column a controller, a row a quantity; up to a fall.

    Raises:
        ValueError: a trajectory without estimates.
    """
    for trajectory in trajectories:
        if not trajectory.estimates:
            raise ValueError(
                f"the trajectory of {trajectory.controller} has no estimates: its task observes no sensors"
            )
    fig = figure(max(3.3 * len(trajectories), 5.0), 8.4)
    rows = len(QUANTITIES) + len(ERRORS)
    axes = fig.subplots(rows, len(trajectories), sharex=True, sharey="row", squeeze=False)
    for column, trajectory in zip(axes.T, trajectories, strict=True):
        _draw_column(column, trajectory)
    for ax, (label, _, _) in zip(axes[:, 0], (*QUANTITIES, *ERRORS), strict=True):
        ax.set_ylabel(label)
    for ax in axes[len(QUANTITIES) :, 0]:
        ax.set_ylim(bottom=0.0)
    for ax in axes[: len(QUANTITIES), -1]:
        ax.legend(loc="best", ncols=2, handlelength=1.6, columnspacing=0.9, borderaxespad=0.1)
    fig.align_ylabels(axes[:, 0])
    return fig


def errors(trajectory: Trajectory, name: str) -> Any:
    """Horizontal distance of estimate and true state, or of their tilts, at each row, shape (n,)."""
    true = trajectory.of_states(name)[: len(trajectory.estimates), :2]
    return np.linalg.norm(trajectory.of_estimates(name)[:, :2] - true, axis=1)


def _draw_column(axes: Sequence[Any], trajectory: Trajectory) -> None:
    times = trajectory.times[: len(trajectory.estimates)]
    axes[0].set_title(f"{short(trajectory.controller)} on {trajectory.model}")
    for ax, (_, name, factor) in zip(axes, QUANTITIES, strict=False):
        true, estimated = trajectory.of_states(name) * factor, trajectory.of_estimates(name) * factor
        for i, axis in enumerate("xy"):
            ax.plot(times, true[: len(times), i], color=COLORS[i], label=f"{axis}, true")
            ax.plot(times, estimated[:, i], color=COLORS[2 + i], linestyle="--", linewidth=1.0, label="estimated")
    for ax, (_, name, factor) in zip(axes[len(QUANTITIES) :], ERRORS, strict=True):
        ax.plot(times, errors(trajectory, name) * factor, color=COLORS[0])
    axes[-1].set_xlabel("time (s)")
