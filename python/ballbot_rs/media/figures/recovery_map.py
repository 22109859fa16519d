"""Polar maps of recovery: the initial tilts and directions from which a controller recovers the robot."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from ballbot_rs.analysis.recovery_map import Recovery
from ballbot_rs.media.figures.labels import title
from ballbot_rs.media.figures.panels import letter
from ballbot_rs.media.figures.style import COLORS, INK, PAPER, below, figure

#: Light is fast; starts without recovery have separate colors.
_TIMES = LinearSegmentedColormap.from_list("recovery", ["#e3fafc", "#66d9e8", COLORS[0], "#083344"])
_FELL, _UNSETTLED, _HATCHED = COLORS[1], COLORS[3], "#ffffff66"

#: Least width of a map, inches.
LEAST_MAP = 2.2


def draw(recoveries: Sequence[Recovery], width: float | None = None) -> Figure:
    """One map per controller; radius is the initial tilt, angle the direction of the lean, color the recovery time.

    Args:
        recoveries: the recoveries to show.
        width: of the figure, inches; None is as wide as the maps need. Maps that do not fit go into rows.
    """
    count = len(recoveries)
    wide = 3.0 * max(count, 2) + 0.8 if width is None else width
    across = min(max(int((wide - 0.8) // LEAST_MAP), 1), count)
    down = -(-count // across)
    fig = figure(wide, down * min((wide - 0.8) / across, 3.0) + 0.9)
    kind = {"projection": "polar"}
    axes = fig.subplots(down, across, subplot_kw=kind, squeeze=False).ravel()
    for ax in axes[count:]:
        ax.remove()
    axes = axes[:count]
    longest = max((float(np.nanmax(r.recovery_times)) for r in recoveries if r.recovered.any()), default=1.0)
    shown: Any = None
    for ax, recovery in zip(axes, recoveries, strict=True):
        shown = _draw_map(ax, recovery, longest, (wide - 0.8) / across)
    if count > 1:
        letter(axes)
    bar = fig.colorbar(shown, ax=list(axes), shrink=0.75, pad=0.06)
    bar.set_label("time to stay within 1 deg (s)")
    bar.outline.set_visible(False)
    unsettled = f"upright, but not within 1 deg to the end of {recoveries[0].seconds:g} s"
    keys = [
        Patch(facecolor=_FELL, edgecolor=_HATCHED, linewidth=0.0, hatch="////", label="fell"),
        Patch(facecolor=_UNSETTLED, edgecolor=_HATCHED, linewidth=0.0, hatch="....", label=unsettled),
        Line2D([], [], color=INK, linewidth=0.8, alpha=0.5, label="rings: initial tilt"),
        Line2D([], [], color=INK, marker="s", linestyle="", markersize=4, label="wheel"),
    ]
    below(fig, keys, 4 if across > 1 else 2)
    return fig


def _draw_map(ax: Any, recovery: Recovery, longest: float, inches: float) -> Any:
    rings, sectors = recovery.recovered.shape
    width = recovery.tilts[0] * 2
    radii = np.degrees(np.arange(rings + 1) * width)
    edges = (np.arange(sectors + 1) - 0.5) * 2 * np.pi / sectors
    ax.set_axisbelow(False)
    ax.grid(False)
    lost = ((~recovery.stood, _FELL, "////"), (recovery.stood & ~recovery.recovered, _UNSETTLED, "...."))
    for those, color, hatch in lost:
        # Hatched also for print without color; an edge of the same color closes the seams between cells.
        cells = np.ma.masked_where(~those, np.ones(those.shape))
        ax.pcolor(edges, radii, cells, cmap=_plain(color), hatch=hatch, edgecolor=_HATCHED, linewidth=0.0)
    times = np.ma.masked_invalid(recovery.recovery_times)
    shown = ax.pcolormesh(edges, radii, times, cmap=_TIMES, vmin=0.0, vmax=longest, edgecolors="face", linewidth=0.3)
    share = 100 * recovery.recovered.mean()
    starts = f"{share:.0f} % of the starts recover"
    limit = f"with up to {recovery.max_wheel_torque:.3g} N·m a wheel"
    ax.set_title(title(recovery.controller, recovery.model, inches, starts, limit), pad=12)
    ticks = np.arange(5, radii[-1], 5)
    _, names = ax.set_rgrids(ticks, [f"{tick:g}°" for tick in ticks], angle=90, fontsize=7.5, color=INK)
    for name in names:
        name.set_path_effects([withStroke(linewidth=2.0, foreground=PAPER)])
    ax.set_thetagrids(np.arange(0, 360, 60), fontsize=8)
    ax.yaxis.grid(True, color=INK, linewidth=0.3, alpha=0.5)
    # Wheels pull along three directions, which explain the shape.
    for azimuth in recovery.wheel_azimuths:
        ax.plot(azimuth, radii[-1] * 0.97, "s", color=INK, markersize=5, markeredgecolor=PAPER, clip_on=False)
    return shown


def _plain(color: str) -> LinearSegmentedColormap:
    return LinearSegmentedColormap.from_list("plain", [color, color])
