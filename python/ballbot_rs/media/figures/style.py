"""How every figure of this project looks, and how it is saved: the same numbers give the same file."""

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

from ballbot_rs import _files

INK, GRID, PAPER = "#212529", "#dee2e6", "#ffffff"
#: Colors that stay apart for the color-blind and on gray paper, in the order of use.
COLORS: Sequence[str] = ("#0b7285", "#d9480f", "#5f3dc4", "#e0a800", "#868e96", "#2b8a3e", "#a61e4d")
#: One color a model, in every figure.
MODEL_COLORS = {"planar": "#5f3dc4", "spatial": "#212529", "contact": "#0b7285", "rigid": "#d9480f"}

_STYLE = {
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
    "svg.fonttype": "none",
    "svg.hashsalt": "ballbot",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


def figure(width: float = 8.0, height: float = 3.2) -> Figure:
    """An empty figure of a size in inches, in the project's style."""
    mpl.rcParams.update(_STYLE)
    fig: Figure = Figure(figsize=(width, height))
    return fig


def save(fig: Figure, path: Path, dpi: int = 150) -> None:
    """Writes the figure; the suffix of `path` chooses SVG, PDF or PNG.

    Raises:
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    undated: dict[str, None] = {"Date": None, "Creator": None} if path.suffix == ".svg" else {}
    drawn = io.BytesIO()
    fig.savefig(drawn, dpi=dpi, format=path.suffix.removeprefix("."), metadata=undated or None)
    _files.write(path, drawn.getvalue())
