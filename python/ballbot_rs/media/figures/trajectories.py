"""Tilt, position, wheel torques and wheel loads of robots over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.style import COLORS, figure

#: From top to bottom.
QUANTITIES = ("tilt (deg)", "ball position (m)", "wheel torque (N·m)", "wheel load (N)")


def draw(trajectories: Sequence[Trajectory]) -> Figure:
    """A column a controller, a row a quantity."""
    fig = figure(max(3.3 * len(trajectories), 5.0), 7.2)
    axes = fig.subplots(4, len(trajectories), sharex=True, sharey="row", squeeze=False)
    for column, trajectory in zip(axes.T, trajectories, strict=True):
        _draw_column(column, trajectory)
    for ax, label in zip(axes[:, 0], QUANTITIES, strict=True):
        ax.set_ylabel(label)
    for ax in axes[:, -1]:
        ax.legend(loc="best", ncols=3, handlelength=1.2, columnspacing=0.9, borderaxespad=0.1)
    fig.align_ylabels(axes[:, 0])
    return fig


def _draw_column(axes: Sequence[Any], trajectory: Trajectory) -> None:
    tilt, position, torque, load = axes
    times = trajectory.times
    tilt.set_title(f"{short(trajectory.controller)} on {trajectory.model}")
    for i, axis in enumerate("xy"):
        tilt.plot(
            times, np.degrees(trajectory.of_states("tilt_components")[:, i]), color=COLORS[i], label=f"about {axis}"
        )
        position.plot(times, trajectory.of_states("ball_position")[:, i], color=COLORS[i], label=axis)
        if trajectory.setpoints["position"].any():
            wanted = {"color": COLORS[4], "linestyle": "--", "linewidth": 1.0, "label": "" if i else "setpoint"}
            position.plot(times, trajectory.setpoints["position"][:, i], **wanted)
    # A torque holds from a row to the next; the last row has none of its own.
    for wheel in range(3):
        style = {"color": COLORS[2 + wheel], "label": f"wheel {wheel}", "linewidth": 1.0}
        torque.plot(times, trajectory.torques[:, wheel], drawstyle="steps-post", **style)
        # Models with contacts know no forces before their first step.
        load.plot(times[1:], trajectory.of_contacts("wheel_normal_forces")[1:, wheel], **style)
    if trajectory.fell_at is not None:
        for ax in axes:
            ax.axvline(trajectory.fell_at, color=COLORS[1], linestyle=":", linewidth=1.0)
        tilt.annotate(
            "motors off",
            (trajectory.fell_at, 0.03),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=8,
            color=COLORS[1],
        )
    load.set_xlabel("time (s)")
