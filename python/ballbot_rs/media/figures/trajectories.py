"""Tilt, position, wheel torques, wheel loads and friction of robots over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import title
from ballbot_rs.media.figures.marks import mark_events, mark_limit
from ballbot_rs.media.figures.panels import LINES, letter, look
from ballbot_rs.media.figures.style import COLORS, INK, columns, legends

#: For readers who do not see it.
DESCRIPTION = "Tilt, position, torques, loads and friction over time"

#: From top to bottom.
QUANTITIES = (
    "tilt about x, y\n(deg)",
    "ball position (m)",
    "wheel torque (N\u00b7m)",
    "wheel load (N)",
    "friction used\n(% of the limit)",
)


def draw(trajectories: Sequence[Trajectory], width: float | None = None) -> Figure:
    """One column per controller, one row per quantity.

    Args:
        trajectories: the trajectories to show.
        width: of the figure, inches; None is as wide as its columns need.

    Raises:
        ValueError: a width out of range, or too narrow for so many controllers.
    """
    fig, axes, each = columns(len(QUANTITIES), len(trajectories), width)
    for column, trajectory in zip(axes.T, trajectories, strict=True):
        _draw_column(column, trajectory)
        # Above the names of the events.
        column[0].set_title(title(trajectory.controller, trajectory.model, each), pad=16)
    for ax, label in zip(axes[:, 0], QUANTITIES, strict=True):
        ax.set_ylabel(label)
    for ax, trajectory in zip(axes[2], trajectories, strict=True):
        if trajectory.max_wheel_torque is not None:
            limit = trajectory.max_wheel_torque
            mark_limit(ax, limit, f"limit {limit:.3g} N\u00b7m")
    for ax in axes[4]:
        mark_limit(ax, 100.0, "limit", both=False)
        ax.set_ylim(bottom=0.0)
    legends(fig, axes[:, -1])
    letter(axes.ravel())
    fig.align_ylabels(axes[:, 0])
    return fig


def _draw_column(axes: Sequence[Any], trajectory: Trajectory) -> None:
    tilt, position, torque, load, friction = axes
    times = trajectory.times
    setpoint = trajectory.setpoints.get("position")
    tilts, positions = trajectory.of_states("tilt_components"), trajectory.of_states("ball_position")
    for i, axis in enumerate("xy"):
        tilt.plot(times, np.degrees(tilts[:, i]), label=axis, **look(i))
        position.plot(times, positions[:, i], label=axis, **look(i))
        if setpoint is not None and setpoint.any():
            dotted = {"color": COLORS[i], "linestyle": ":", "linewidth": 1.0, "label": f"{axis}, setpoint"}
            position.plot(times, setpoint[:, i], **dotted)
    # Models with contacts have no forces before their first step.
    loads = trajectory.of_contacts("wheel_normal_forces")[1:]
    shares = 100.0 * trajectory.of_contacts("friction_utilization")[1:]
    # A torque holds from a row to the next; the last row has no separate torque.
    for wheel in range(3):
        style = {"color": COLORS[2 + wheel], "linestyle": LINES[wheel], "label": f"wheel {wheel}", "linewidth": 1.0}
        torque.plot(times, trajectory.torques[:, wheel], drawstyle="steps-post", **style)
        load.plot(times[1:], loads[:, wheel], **style)
        friction.plot(times[1:], shares[:, wheel], **style)
    friction.plot(times[1:], shares[:, 3], color=INK, linestyle=LINES[3], linewidth=1.0, label="floor")
    mark_events(axes, trajectory)
    friction.set_xlabel("time (s)")
