"""Phase portrait: tilt rate over tilt."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ballbot_rs._state_rows import tilt_rates_of
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.panels import letter, look
from ballbot_rs.media.figures.style import FULL_WIDTH, INK, below, figure


def draw(trajectories: Sequence[Trajectory], width: float | None = None) -> Figure:
    """Both planes of the tilt, side by side or, in a narrow figure, stacked; one color per controller.

    Args:
        trajectories: the trajectories to show.
        width: of the figure, inches; None is 8.
    """
    wide = 8.0 if width is None else width
    panels = (1, 2) if wide >= FULL_WIDTH else (2, 1)
    fig = figure(wide, 0.5 * wide + 0.3 if wide >= FULL_WIDTH else 1.6 * wide + 0.5)
    axes = fig.subplots(*panels, sharex=True, sharey=True)
    for i, (ax, axis) in enumerate(zip(axes, "xy", strict=True)):
        for number, trajectory in enumerate(trajectories):
            tilts, rates = tilts_and_rates(trajectory, i)
            style = look(number)
            color = style["color"]
            ax.plot(np.degrees(tilts), np.degrees(rates), linewidth=1.2, **style)
            ax.plot(np.degrees(tilts[0]), np.degrees(rates[0]), "o", color=color, markersize=4)
            for push in trajectory.all_pushes:
                row = int(np.searchsorted(trajectory.times, push.time))
                if row < len(tilts):
                    ax.plot(np.degrees(tilts[row]), np.degrees(rates[row]), "D", color=color, markersize=4)
        ax.plot(0, 0, "+", color=INK, markersize=9)
        ax.set_xlabel(f"tilt about {axis} (deg)")
    for ax in axes if panels == (2, 1) else axes[:1]:
        ax.set_ylabel("tilt rate (deg/s)")
    keys = [
        Line2D([], [], label=f"{short(one.controller)} on {one.model}", **look(number))
        for number, one in enumerate(trajectories)
    ]
    letter(axes)
    keys.append(_mark("o", "start"))
    if any(one.all_pushes for one in trajectories):
        keys.append(_mark("D", "push"))
    below(fig, [*keys, _mark("+", "upright")], 4)
    return fig


def _mark(marker: str, label: str) -> Line2D:
    return Line2D([], [], color=INK, marker=marker, linestyle="", markersize=4 if marker != "+" else 9, label=label)


def tilts_and_rates(trajectory: Trajectory, axis: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Tilt about an axis, rad, and its rate, rad/s, in the states up to the fall."""
    end = len(trajectory.times)
    if trajectory.fell_at is not None:
        end = max(int(np.searchsorted(trajectory.times, trajectory.fell_at)), 2)
    tilts = trajectory.of_states("tilt_components")[:end, axis]
    return tilts, tilt_rates_of(trajectory.to_array()[:end])[:, axis]
