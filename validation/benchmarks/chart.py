"""The chart of the README: environment steps per second on one core, one bar per simulator."""

import math
from pathlib import Path
from typing import Any

from validation.benchmarks.names import label, strongest
from validation.benchmarks.task import HEADLINE_TORQUE

_OURS, _PEER, _INK = "#0b7285", "#adb5bd", "#212529"


def draw(throughput: list[dict[str, Any]], path: Path) -> None:
    """Writes the SVG; the same numbers give the same file."""
    import matplotlib as mpl

    mpl.use("svg")
    import matplotlib.pyplot as plt

    rows = strongest(throughput, "environment", 1)
    if not rows:
        return
    mpl.rcParams.update({"svg.hashsalt": "ballbot", "svg.fonttype": "none", "font.size": 11, "text.color": _INK})
    fig, axes = plt.subplots(figsize=(8.0, 0.55 * len(rows) + 1.1), layout="constrained")
    rows = sorted(rows, key=lambda row: float(row["median"]))
    for at, row in enumerate(rows):
        median = row["median"]
        axes.barh(at, median, color=_OURS if row["simulator"].startswith("ours:") else _PEER, height=0.65)
        errors = [[median - row["min"]], [row["max"] - median]]
        axes.errorbar(median, at, xerr=errors, color=_INK, linewidth=1.0, capsize=3.0)
        axes.annotate(
            f"{median:,.0f}", (row["max"], at), xytext=(6, 0), textcoords="offset points", va="center", color=_INK
        )
    axes.set_yticks(range(len(rows)), [label(row["simulator"]) for row in rows])
    axes.set_xscale("log")
    low, high = rows[0]["min"], rows[-1]["max"]
    axes.set_xlim(10.0 ** int(math.log10(low) - 0.3), high * 8.0)
    axes.set_xlabel(f"environment steps a second on one core, actions of ±{HEADLINE_TORQUE} N·m")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0.0)
    axes.grid(axis="x", color="#dee2e6", linewidth=0.6)
    axes.set_axisbelow(True)
    fig.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
