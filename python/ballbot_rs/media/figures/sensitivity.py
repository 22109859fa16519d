"""Bars of the effects of each parameter on a motion."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ballbot_rs.analysis.sensitivity import CHANGE, QUANTITIES, Sensitivity
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.panels import HATCHES, letter
from ballbot_rs.media.figures.style import COLORS, FULL_WIDTH, PAPER, below, figure


def draw(sensitivities: Sequence[Sensitivity], width: float | None = None) -> Figure:
    """A panel per quantity, a row per parameter, a color per controller; the parameters with the largest effects.

    Args:
        sensitivities: of the same parameters of one robot.
        width: of the figure, inches; None is 9.
    """
    wide = 9.0 if width is None else width
    first = sensitivities[0].largest()
    places, count = np.arange(len(first.names)), len(sensitivities)
    narrow = wide < FULL_WIDTH
    row = (0.13 if narrow else 0.19) + 0.07 * (count - 1)
    panels = (2, 2) if narrow else (1, 4)
    fig = figure(wide, (0.9 + row * len(places)) * panels[0] + 0.5)
    axes = fig.subplots(*panels, sharey=True).ravel()
    for ax, (name, unit) in zip(axes, QUANTITIES.items(), strict=True):
        for i, one in enumerate(sensitivities):
            values = [one.effects[name][one.names.index(parameter)] for parameter in first.names]
            offset = (i - 0.5 * (count - 1)) * 0.8 / count
            ax.barh(places + offset, values, 0.8 / count, **_fill(i))
        ax.set_xlabel(f"{name}\n({unit})")
        ax.grid(visible=False, axis="y")
    axes[0].set_yticks(places, [first.label(i) for i in range(len(places))])
    axes[0].invert_yaxis()
    for ax in axes:
        ax.tick_params(axis="y", labelsize="small" if narrow else "medium", length=0)
    keys = [Patch(label=f"{short(one.controller)} on {one.model}", **_fill(i)) for i, one in enumerate(sensitivities)]
    title = f"largest change of the motion by a change of {100 * CHANGE:g} % of a typical size"
    fig.suptitle(textwrap.fill(title, round(14 * wide)), fontsize="medium")
    letter(axes)
    below(fig, keys, 4)
    return fig


def _fill(number: int) -> dict[str, Any]:
    colored = {"facecolor": COLORS[number % len(COLORS)], "edgecolor": PAPER, "linewidth": 0.0}
    return {**colored, "hatch": HATCHES[number % len(HATCHES)]}
