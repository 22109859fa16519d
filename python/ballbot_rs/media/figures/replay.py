"""A log and its simulation: tilt, body rates and wheel speeds over time, and residuals of all windows."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.replay import Replay
from ballbot_rs.identification.simulation import SENSORS
from ballbot_rs.media.figures.style import COLORS, GRID, INK, below, figure

Array = npt.NDArray[np.float64]

#: Rows of the part over time: title, factor of the unit, names of the components.
PARTS: Final = (
    ("tilt (deg)", 180.0 / np.pi, ("about x", "about y")),
    ("body rates (deg/s)", 180.0 / np.pi, ("x", "y", "z")),
    ("wheel speeds (rad/s)", 1.0, ("wheel 0", "wheel 1", "wheel 2")),
)
#: Colors of the components, and of the sensors.
_SENSORS: Final = {"wheel_angle": COLORS[3], "gyro": COLORS[4], "acceleration": COLORS[5]}


def draw(replay: Replay, begin: float | None = None, seconds: float = 4.0, width: float = 8.0) -> Figure:
    """Measured (solid) and simulated (dashed) quantities of a span, and residuals of the whole log.

    Args:
        replay: the replay.
        begin: of the span, s of the log; None is its first row.
        seconds: duration of the span.
        width: of the figure, inches.

    Raises:
        ValueError: a span without rows, or a width out of range.
    """
    first = float(replay.time[0]) if begin is None else begin
    shown = (replay.time >= first) & (replay.time <= first + seconds)
    if not shown.any():
        raise InvalidInputError(
            f"no row from {first:g} to {first + seconds:g} s: the windows have {replay.time[0]:g} to "
            f"{replay.time[-1]:g} s"
        )
    fig = figure(width, 8.5)
    axes = fig.subplots(4, 1)
    pairs = (
        (replay.measured_tilt, replay.simulated_tilt),
        (replay.measured[:, SENSORS["gyro"]], replay.simulated[:, SENSORS["gyro"]]),
        (replay.measured_speeds, replay.simulated_speeds),
    )
    for ax, (label, factor, names), (measured, simulated) in zip(axes, PARTS, pairs, strict=False):
        for index, name in enumerate(names):
            style: dict[str, Any] = {"color": COLORS[index], "linewidth": 1.0}
            ax.plot(*_broken(replay, factor * measured[:, index], shown), label=name, alpha=0.45, **style)
            ax.plot(*_broken(replay, factor * simulated[:, index], shown), linestyle="--", **style)
        for start in replay.begins:
            if first <= start <= first + seconds:
                ax.axvline(start, color=GRID, linewidth=1.0, zorder=0)
        ax.set_ylabel(label)
        ax.set_xlim(first, min(first + seconds, float(replay.time[-1])))
        ax.legend(loc="upper right", ncols=len(names), handlelength=1.2)
        ax.margins(y=0.2)
    axes[0].set_title(f"{replay.model}, {first:g} to {first + seconds:g} s")
    axes[2].set_xlabel("time (s); lines: start of a window")
    for name, values in replay.of_windows.items():
        axes[3].plot(replay.begins, values, ".-", color=_SENSORS[name], linewidth=0.8, label=name.replace("_", " "))
    axes[3].axhline(1.0, color=INK, linewidth=0.8, linestyle=":")
    axes[3].set_ylabel("rms residual\n(noise of the sensor)")
    axes[3].set_xlabel("start of the window (s)")
    axes[3].legend(loc="upper right", ncols=3, handlelength=1.2)
    axes[3].margins(y=0.35)
    axes[3].set_ylim(bottom=0.0)
    handles = [
        Line2D([], [], color=INK, alpha=0.45, label="measured"),
        Line2D([], [], color=INK, linestyle="--", label="simulated"),
    ]
    below(fig, handles, 2)
    fig.align_ylabels(axes)
    return fig


def _broken(replay: Replay, values: Array, shown: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """Times and values of the rows shown, with a NaN before each window, where the line breaks."""
    rows = np.flatnonzero(shown)
    breaks = np.flatnonzero(np.diff(replay.windows.window[rows])) + 1
    return np.insert(replay.time[rows], breaks, np.nan), np.insert(values[rows], breaks, np.nan)
