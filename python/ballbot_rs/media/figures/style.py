"""Style and output of every figure of this project: the same numbers give the same file."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

from ballbot_rs import _files

INK, GRID, PAPER = "#212529", "#dee2e6", "#ffffff"
#: Colors that are distinguishable by the color-blind and on gray paper, in the order of use.
COLORS: Sequence[str] = ("#0b7285", "#d9480f", "#5f3dc4", "#e0a800", "#868e96", "#2b8a3e", "#a61e4d")
#: One color per model, in every figure.
MODEL_COLORS = {"planar": "#5f3dc4", "spatial": "#212529", "contact": "#0b7285", "rigid": "#d9480f"}

_STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.facecolor": PAPER,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10.5,
    "figure.constrained_layout.use": True,
    "figure.facecolor": PAPER,
    "font.size": 10.0,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    # TrueType, which journals require; the default, Type 3, is rejected by many.
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "ballbot",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
_NARROW = {"font.size": 8.0, "axes.titlesize": 8.5, "legend.fontsize": 7.5, "lines.linewidth": 1.1}


#: Width from which letters have their usual size and panels are side by side, inches; one column of a paper is less.
FULL_WIDTH = 5.0
#: Width of legends at the right of wide figures, and least width of a column, inches.
LEGENDS, LEAST_COLUMN = 1.1, 1.5
#: Narrowest and widest figure, inches.
WIDTHS = (2.0, 40.0)


def figure(width: float = 8.0, height: float = 3.2) -> Figure:
    """An empty figure of a size in inches, in the project's style; a narrow one has smaller letters.

    Raises:
        ValueError: a width out of range.
    """
    lowest, highest = WIDTHS
    if not lowest <= width <= highest:
        limits = f"it must be from {25.4 * lowest:.0f} to {25.4 * highest:.0f} mm"
        raise ValueError(f"a figure of {25.4 * width:g} mm is out of range: {limits}")
    mpl.rcParams.update(_STYLE)
    if width < FULL_WIDTH:
        mpl.rcParams.update(_NARROW)
    fig: Figure = Figure(figsize=(width, height))
    return fig


def columns(rows: int, count: int, width: float | None) -> tuple[Figure, Any, float]:
    """A figure of columns with common axes and room for legends; its axes; the width of a column, inches.

    Raises:
        ValueError: a width out of range, or too narrow for so many columns.
    """
    wide = max(3.0 * count, 4.2) + LEGENDS if width is None else width
    right = LEGENDS if wide >= FULL_WIDTH else 0.0
    each = (wide - right) / count
    if each < LEAST_COLUMN:
        least = 25.4 * (LEAST_COLUMN * count + right)
        raise ValueError(
            f"a width of {25.4 * wide:g} mm is too narrow for {count} controllers: at least {least:.0f} mm"
        )
    fig = figure(wide, min(1.7 if right else 1.15, 0.8 + 0.3 * each) * rows + (0.0 if right else 0.7))
    return fig, fig.subplots(rows, count, sharex=True, sharey="row", squeeze=False), each


def legends(fig: Figure, axes: Sequence[Any]) -> None:
    """Legends of rows of panels: to the right of each or, in one column of a paper, one below all."""
    if fig.get_figwidth() >= FULL_WIDTH:
        for ax in axes:
            if ax.get_legend_handles_labels()[0]:
                ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0.0, handlelength=2.0)
        return
    named: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            named.setdefault(label, handle)
    across = 4 if max(map(len, named)) < 12 else 2
    options = {"ncols": across, "handlelength": 2.0, "columnspacing": 1.2}
    fig.legend(named.values(), named.keys(), loc="outside lower center", **options)


def below(fig: Figure, handles: Sequence[Any], columns: int) -> None:
    """Places a legend of the whole figure below it."""
    if fig.get_figwidth() < FULL_WIDTH:
        columns = max(columns // 2, 1)
    fig.legend(handles=handles, loc="outside lower center", ncols=min(columns, len(handles)), handlelength=2.0)


def check_suffix(path: Path) -> None:
    """Checks that a file's name has the suffix of a figure.

    Raises:
        ValueError: another suffix.
    """
    if path.suffix not in (".svg", ".pdf", ".png"):
        raise ValueError(f"{path}: the name of a figure must end in .svg, .pdf or .png")


def save(fig: Figure, path: Path, dpi: int = 150) -> None:
    """Writes the figure; the suffix of `path` chooses SVG, PDF or PNG.

    Raises:
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    undated: dict[str, None] = {"Date": None, "Creator": None} if path.suffix == ".svg" else {}
    drawn = io.BytesIO()
    fig.savefig(drawn, dpi=dpi, format=path.suffix.removeprefix("."), metadata=undated or None)
    _files.write(path, drawn.getvalue())
