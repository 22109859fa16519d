"""Learning curves: return and success over environment steps, each run and their mean."""

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ballbot_rs.media.figures.panels import MARKERS, letter, look
from ballbot_rs.media.figures.style import FULL_WIDTH, INK, below, figure
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
    keys: list[Any] = []
    for number, group in enumerate(by_configuration(curves)):
        _draw_group(returns, group, "returns", 1.0, number)
        _draw_group(successes, group, "successes", 100.0, number)
        seeds = ", ".join(str(seed) for seed in sorted({curve.seed for curve in group}))
        keys.append(Line2D([], [], label=f"{'mean of seeds' if len(group) > 1 else 'seed'} {seeds}", **_style(number)))
    if any(len(group) > 1 for group in by_configuration(curves)):
        keys += [
            Line2D([], [], color=INK, linewidth=0.8, alpha=0.6, label="one seed"),
            Patch(color=INK, alpha=0.15, linewidth=0, label="range of the seeds"),
        ]
    else:
        keys.append(Patch(color=INK, alpha=0.15, linewidth=0, label="range of the episodes"))
    returns.set_ylabel("return of an episode")
    successes.set_ylabel("successful episodes (%)")
    successes.set_ylim(-3, 103)
    for ax in (returns, successes):
        ax.set_xlabel("environment steps (thousands)")
        ax.set_xlim(left=0)
    letter((returns, successes))
    below(fig, keys, 4)


def _style(number: int) -> dict[str, Any]:
    return {**look(number), "marker": MARKERS[number % len(MARKERS)], "markersize": 3.5}


def _draw_group(ax: Any, group: Sequence[Curve], name: str, scale: float, number: int) -> None:
    color = look(number)["color"]
    if len(group) == 1:
        (curve,) = group
        steps, values = curve.timesteps, scale * getattr(curve, name)
        bounds = values.min(axis=1), values.max(axis=1)
        means = values.mean(axis=1)
    else:
        for curve in group:
            each = scale * getattr(curve, name).mean(axis=1)
            ax.plot(curve.timesteps / 1e3, each, color=color, linewidth=0.8, alpha=0.6)
        steps, of_seeds = on_common_steps(group, name)
        means, bounds = scale * of_seeds.mean(axis=0), (scale * of_seeds.min(axis=0), scale * of_seeds.max(axis=0))
    ax.plot(steps / 1e3, means, **_style(number))
    if name == "returns" or len(group) > 1:
        ax.fill_between(steps / 1e3, *bounds, color=color, alpha=0.15, linewidth=0)
