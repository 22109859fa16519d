"""Live plots of robot 0: position, lean and wheels."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import viser
from viser import uplot

from ballbot_rs.viewer.panels.controls import put
from ballbot_rs.viewer.session.recording import SERIES, History

FloatArray = npt.NDArray[np.float64]

#: Distinguishable by color-blind people, with a contrast of 3:1 or more on white and on the dark panel.
COLORS = ("#2f80c8", "#c9640a", "#2f9442", "#7d7d7d")
LIMIT_COLOR = "#d9363e"

#: A contact without load has no limit: its utilization is infinite, and drawn at this height.
TOP = 2.0

#: Heights of a plot, px.
HEIGHT = 130

#: Names of additional curves, and their dashes.
ESTIMATE, GHOST = "estimate", "compared with"
DASHES = {ESTIMATE: (5.0, 4.0), GHOST: (2.0, 3.0)}

WHEELS = ("wheel 0", "wheel 1", "wheel 2")


@dataclasses.dataclass(frozen=True)
class Plot:
    """One plot."""

    title: str
    unit: str
    #: Row of `SERIES`, and the curves in it.
    row: str
    curves: tuple[str, ...]
    #: Limits of the ordinate that hold at least, so that rounding noise does not fill a plot.
    least: tuple[float, float]
    #: Factor to the unit shown.
    factor: float = 1.0
    #: Rows drawn in addition where they have values: names of row and curves, and a key of `DASHES`.
    others: tuple[tuple[str, str], ...] = ()
    #: A line at this height, and its name.
    limit: tuple[float, str] | None = None


PLOTS = (
    Plot("Ball position", "m", "position", ("x", "y"), (-0.1, 0.1), others=(("ghost position", GHOST),)),
    Plot("Ball speed", "m/s", "speed", ("speed",), (0.0, 0.1), others=(("ghost speed", GHOST),)),
    Plot(
        "Tilt",
        "deg",
        "tilt",
        ("about x", "about y"),
        (-0.5, 0.5),
        180.0 / math.pi,
        (("estimated tilt", ESTIMATE), ("ghost tilt", GHOST)),
    ),
    Plot("Wheel torques", "N·m", "torques", WHEELS, (-0.02, 0.02)),
    Plot("Wheel loads", "N", "loads", WHEELS, (0.0, 1.0)),
    Plot("Slip speeds", "m/s", "slip", WHEELS, (-0.01, 0.01)),
    Plot("Traction in use", "", "utilization", (*WHEELS, "floor"), (0.0, 1.1), limit=(1.0, "limit")),
)


class Plots:
    """A chart for each of `PLOTS`, below its title and legend."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._charts = [_Chart(server, plot) for plot in PLOTS]

    def show(self, history: History) -> None:
        """Draws the last seconds."""
        series = history.series()
        # A chart of one sample has no abscissa.
        if series.shape[1] > 1:
            for chart in self._charts:
                chart.show(series)

    def set_dark(self, is_dark: bool) -> None:
        """Draws them in light or dark colors."""
        for chart in self._charts:
            chart.set_axes(axes_of(is_dark))


def axes_of(is_dark: bool) -> tuple[uplot.Axis, uplot.Axis]:
    """Abscissa and ordinate."""
    ink, lines = ("#c3c9d1", "#3a414b") if is_dark else ("#333", "#e4e7eb")
    grid, ticks = uplot.Axis_Grid(stroke=lines, width=1), uplot.Axis_Ticks(stroke=lines, width=1, size=4)
    axis = uplot.Axis(size=46, font="11px sans-serif", stroke=ink, ticks=ticks, grid=grid, gap=4)
    return {**axis, "size": 24}, axis


class _Chart:
    def __init__(self, server: viser.ViserServer, plot: Plot) -> None:
        self._plot = plot
        styles = [uplot.Series(label=n, stroke=c, width=1.5) for n, c in zip(plot.curves, COLORS, strict=False)]
        curves = list(styles)
        for _, name in plot.others:
            styles += [uplot.Series(**style, dash=DASHES[name]) for style in curves]
        if plot.limit is not None:
            styles.append(uplot.Series(label=plot.limit[1], stroke=LIMIT_COLOR, width=1.5, dash=(6.0, 4.0)))
        self._legend = server.gui.add_html(legend_of(plot, ()))
        low, high = plot.least
        self._handle = server.gui.add_uplot(
            tuple(np.array([0.0, 1.0]) for _ in range(len(styles) + 1)),
            (uplot.Series(label="time (s)"), *styles),
            scales={"x": {"time": False}, "y": {"range": {"min": _soft(low), "max": _soft(high)}}},
            axes=axes_of(is_dark=False),
            legend={"show": False},
            cursor={"drag": {"x": False, "y": False}},
            height=HEIGHT,
            padding=(6, 12, 0, 0),
        )

    def set_axes(self, axes: tuple[uplot.Axis, uplot.Axis]) -> None:
        self._handle.axes = axes

    def show(self, series: FloatArray) -> None:
        plot = self._plot
        values = plot.factor * series[SERIES[plot.row]]
        if plot.limit is not None:
            values = np.nan_to_num(np.minimum(values, TOP), nan=0.0)
        curves = list(values)
        shown = []
        for row, name in plot.others:
            others = plot.factor * series[SERIES[row]]
            if np.isfinite(others).any():
                shown.append(name)
            # Where it has no values, its curve is hidden by the other.
            curves += list(np.where(np.isfinite(others), others, values))
        put(self._legend, content=legend_of(plot, shown))
        if plot.limit is not None:
            curves.append(np.full_like(series[0], plot.limit[0]))
        self._handle.data = (np.round(series[0], 3), *(np.round(curve, 5) for curve in curves))


def legend_of(plot: Plot, others: Sequence[str]) -> str:
    """Title, unit, and the names of the curves in their colors."""
    unit = f" ({plot.unit})" if plot.unit else ""
    keys = [_key(name, color, "solid") for name, color in zip(plot.curves, COLORS, strict=False)]
    keys += [_key(name, COLORS[3], "dashed" if name == ESTIMATE else "dotted") for name in others]
    if plot.limit is not None:
        keys.append(_key(plot.limit[1], LIMIT_COLOR, "dashed"))
    # The title names a single curve.
    shown = "".join(keys) if len(keys) > 1 else ""
    return f'<div class="ballbot-legend"><b>{plot.title}{unit}</b>{shown}</div>'


def _key(name: str, color: str, line: str) -> str:
    return f'<span><i style="border-top: 2px {line} {color}"></i>{name}</span>'


def _soft(value: float) -> dict[str, float]:
    """A bound that holds unless the data exceed it."""
    return {"pad": 0.08, "soft": value, "mode": 1}
