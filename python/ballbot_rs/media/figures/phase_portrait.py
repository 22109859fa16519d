"""Phase portrait: tilt rate over tilt."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.style import COLORS, INK, figure


def draw(trajectories: Sequence[Trajectory]) -> Figure:
    """Both planes of the tilt, side by side; a color a controller."""
    fig = figure(8.0, 3.8)
    for i, (ax, axis) in enumerate(zip(fig.subplots(1, 2, sharex=True, sharey=True), "xy", strict=True)):
        for trajectory, color in zip(trajectories, _colors(len(trajectories)), strict=True):
            tilts, rates = tilts_and_rates(trajectory, i)
            label = f"{short(trajectory.controller)} on {trajectory.model}"
            ax.plot(np.degrees(tilts), np.degrees(rates), color=color, linewidth=1.2, label=label)
            ax.plot(np.degrees(tilts[0]), np.degrees(rates[0]), "o", color=color, markersize=4)
        ax.plot(0, 0, "+", color=INK, markersize=9)
        ax.set_xlabel(f"tilt about {axis} (deg)")
        ax.set_title("dots: start, cross: upright" if i else "")
    fig.axes[0].set_ylabel("tilt rate (deg/s)")
    fig.axes[0].legend(loc="best")
    return fig


def tilts_and_rates(trajectory: Trajectory, axis: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Tilt about an axis and its rate, as differences over the rows around each; until the robot fell."""
    end = len(trajectory.times)
    if trajectory.fell_at is not None:
        end = max(int(np.searchsorted(trajectory.times, trajectory.fell_at)), 2)
    tilts = trajectory.of_states("tilt_components")[:end, axis]
    if len(tilts) < 2:
        return tilts, np.zeros_like(tilts)
    return tilts, np.gradient(tilts, trajectory.times[:end])


def _colors(count: int) -> list[str]:
    return [COLORS[i % len(COLORS)] for i in range(count)]
