"""Bars of the effects of each parameter on a motion."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ballbot_rs.analysis.sensitivity import CHANGE, QUANTITIES, Sensitivity
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.style import COLORS, FULL_WIDTH, below, figure


def draw(sensitivities: Sequence[Sensitivity], width: float | None = None) -> Figure:
    """A panel per quantity, a row per parameter, a color per controller; the parameters with the largest effects.

    Args:
        sensitivities: of the same parameters of one robot.
        width: of the figure, inches; None is 9.
    """
    wide = 9.0 if width is None else width
    first = sensitivities[0].largest()
    places, count = np.arange(len(first.names)), len(sensitivities)
    panels = (1, 4) if wide >= FULL_WIDTH else (4, 1)
    row = 0.19 + 0.07 * (count - 1)
    fig = figure(wide, (1.1 + row * len(places)) * panels[0] + 0.4)
    axes = fig.subplots(*panels, sharey=True)
    for ax, (name, unit) in zip(axes, QUANTITIES.items(), strict=True):
        for i, one in enumerate(sensitivities):
            values = [one.effects[name][one.names.index(parameter)] for parameter in first.names]
            offset = (i - 0.5 * (count - 1)) * 0.8 / count
            ax.barh(places + offset, values, 0.8 / count, color=COLORS[i % len(COLORS)])
        ax.set_xlabel(f"{name} ({unit})")
        ax.grid(visible=False, axis="y")
    axes[0].set_yticks(places, [first.label(i) for i in range(len(places))])
    axes[0].invert_yaxis()
    keys = [
        Patch(color=COLORS[i % len(COLORS)], label=f"{short(one.controller)} on {one.model}")
        for i, one in enumerate(sensitivities)
    ]
    fig.suptitle(f"largest change of the motion by a change of {100 * CHANGE:g} % of a typical size", fontsize="medium")
    below(fig, keys, 4)
    return fig
