"""Panels of a figure: letters, ticks of logarithmic axes, and looks of curves that need no color."""

import math
from collections.abc import Iterable
from typing import Any, Final

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from ballbot_rs.media.figures.style import COLORS, MODEL_COLORS

#: Lines and markers in the order of `COLORS`.
LINES: Final = (
    *("-", (0, (5, 1.6)), (0, (5, 1.6, 1, 1.6)), (0, (1, 2))),
    *((0, (9, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (2, 2))),
)
MARKERS: Final = "os^Dv<>"
#: Curves of models that lie on one another: the earlier ones are wider, the last has gaps.
MODEL_LOOKS: Final[dict[str, dict[str, Any]]] = {
    "planar": {"color": MODEL_COLORS["planar"], "linewidth": 3.4, "alpha": 0.45},
    "spatial": {"color": MODEL_COLORS["spatial"], "linewidth": 3.0, "alpha": 0.5},
    "contact": {"color": MODEL_COLORS["contact"], "linewidth": 1.9},
    "rigid": {"color": MODEL_COLORS["rigid"], "linewidth": 1.2, "linestyle": (0, (4, 4))},
}
#: Fills of areas and bars in the order of `COLORS`.
HATCHES: Final = ("", "////", "....", "xxxx", "----", "\\\\\\\\", "++++")
_LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
#: Axes of fewer decades have plain numbers at 1, 2 and 5 of each, and more within one decade.
_FEW_DECADES: Final = 2.5


def look(number: int) -> dict[str, Any]:
    """Color and dashes of a curve, different from the others' also in print without color."""
    return {"color": COLORS[number % len(COLORS)], "linestyle": LINES[number % len(LINES)]}


def finish(fig: Figure) -> None:
    """Letters the panels of a figure and labels its logarithmic axes."""
    axes = [ax for ax in fig.axes if ax.get_label() != "<colorbar>"]
    for ax in axes:
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_scale() == "log":
                _label_decades(axis)
    lettered = any(text.get_text() == "(a)" for ax in axes for text in ax.texts)
    if len(axes) > 1 and not lettered:
        letter(axes)


def letter(axes: Iterable[Any]) -> None:
    """(a), (b), (c) at the upper left corners, where there are neither curves nor titles."""
    for ax, name in zip(axes, _LETTERS, strict=False):
        ax.annotate(
            f"({name})",
            (0.0, 1.0),
            xycoords="axes fraction",
            xytext=(-3, 6),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontweight="bold",
            annotation_clip=False,
        )


def _label_decades(axis: Any) -> None:
    low, high = axis.get_view_interval()
    decades = math.log10(high / low) if 0.0 < low < high else _FEW_DECADES
    if decades >= _FEW_DECADES:
        return
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades > 0.8 else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())
