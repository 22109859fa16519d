"""Learning curves: return and success over environment steps, each run and their mean."""

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from ballbot_rs.media.figures.style import COLORS, FULL_WIDTH, below, figure
from ballbot_rs.training.curve import Curve, by_configuration, on_common_steps


def draw(curves: Sequence[Curve], width: float | None = None) -> Figure:
    """Mean return and success rate of each evaluation's episodes; one color per configuration.

    Args:
        curves: the curves to show.
        width: of the figure, inches; None is 8. In a narrow figure the panels are stacked.
    """
    wide = 8.0 if width is None else width
    fig = figure(wide, 0.4 * wide if wide >= FULL_WIDTH else 1.3 * wide)
    draw_on(fig, curves)
    return fig


def draw_on(fig: Figure, curves: Sequence[Curve]) -> None:
    """As `draw`, on an existing figure."""
    returns, successes = fig.subplots(1, 2) if fig.get_figwidth() >= FULL_WIDTH else fig.subplots(2, 1)
    for group, color in zip(by_configuration(curves), _cycle(), strict=False):
        _draw_group(returns, group, "returns", 1.0, color)
        _draw_group(successes, group, "successes", 100.0, color)
    returns.set_ylabel("return of an episode")
    successes.set_ylabel("successful episodes (%)")
    successes.set_ylim(-3, 103)
    for ax in (returns, successes):
        ax.set_xlabel("environment steps (thousands)")
        ax.set_xlim(left=0)
    below(fig, successes.get_legend_handles_labels()[0], 4)


def _draw_group(ax: Any, group: Sequence[Curve], name: str, scale: float, color: str) -> None:
    if len(group) == 1:
        (curve,) = group
        values = scale * getattr(curve, name)
        ax.plot(
            curve.timesteps / 1e3, values.mean(axis=1), "o-", color=color, markersize=3.5, label=f"seed {curve.seed}"
        )
        if name == "returns":
            low, high = values.min(axis=1), values.max(axis=1)
            ax.fill_between(curve.timesteps / 1e3, low, high, color=color, alpha=0.15, linewidth=0)
        return
    for curve in group:
        means = scale * getattr(curve, name).mean(axis=1)
        ax.plot(curve.timesteps / 1e3, means, color=color, linewidth=0.8, alpha=0.6)
    steps, means = on_common_steps(group, name)
    seeds = ", ".join(str(seed) for seed in sorted({curve.seed for curve in group}))
    ax.plot(steps / 1e3, scale * means.mean(axis=0), color=color, linewidth=2.2, label=f"mean of seeds {seeds}")
    low, high = scale * means.min(axis=0), scale * means.max(axis=0)
    ax.fill_between(steps / 1e3, low, high, color=color, alpha=0.15, linewidth=0)


def _cycle() -> list[str]:
    return list(COLORS) * 100
