"""Legends that would lie on what axes show are moved."""

import numpy as np
import pytest

from ballbot_rs.media.figures.legends import clear_curves, hides
from ballbot_rs.media.figures.style import figure


def axes_with(x, y, place, *style, **options):
    fig = figure(5.0, 3.0)
    ax = fig.subplots()
    ax.plot(x, y, *style, label="a curve with a long name", **options)
    ax.legend(loc=place)
    return fig, ax


@pytest.mark.parametrize("style", ["-", "o"])
@pytest.mark.parametrize("place", ["upper right", "lower left"])
def test_a_legend_on_a_curve_moves_to_a_free_corner(place, style):
    x = np.linspace(0.0, 1.0, 300)
    fig, ax = axes_with(x, x, place, style)
    before = ax.get_legend()
    clear_curves(fig)
    fig.draw_without_rendering()
    assert not hides(ax)
    assert ax.get_legend() is before, "it moves within the axes"


def test_a_legend_without_a_free_corner_moves_above():
    x = np.linspace(0.0, 1.0, 4000)
    fig, ax = axes_with(x, np.sin(600.0 * x), "center")
    clear_curves(fig)
    fig.draw_without_rendering()
    box = ax.get_legend().get_window_extent()
    assert box.y0 >= ax.get_window_extent().y1 - 1.0
    assert box.y1 <= fig.bbox.y1 + 1.0
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["a curve with a long name"]


def test_a_legend_that_hides_nothing_stays():
    fig, ax = axes_with([0.0, 1.0], [0.0, 1.0], "upper left")
    fig.draw_without_rendering()
    place = ax.get_legend().get_window_extent().bounds
    clear_curves(fig)
    fig.draw_without_rendering()
    assert ax.get_legend().get_window_extent().bounds == pytest.approx(place)


def test_bands_bars_and_texts_count_as_what_is_shown():
    for show in (
        lambda ax: ax.fill_between([0.0, 1.0], 0.6, 1.0),
        lambda ax: ax.bar([0.9], [1.0], 0.2),
        lambda ax: ax.text(0.85, 0.85, "printed"),
    ):
        fig, ax = axes_with([0.0, 1.0], [0.0, 0.0], "upper right")
        ax.set_ylim(0.0, 1.0)
        show(ax)
        fig.draw_without_rendering()
        assert hides(ax)
        clear_curves(fig)
        fig.draw_without_rendering()
        assert not hides(ax)
