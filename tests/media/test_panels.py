"""Panels of figures: common axes, letters, ticks, and files that journals accept."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.media.figures import overlay, panels, phase_portrait, trajectories
from ballbot_rs.media.figures.style import figure, save


@pytest.fixture(scope="module")
def moving():
    push = bb.Push((0.3, 0.0, 0.0), 0.5)
    return [bb.simulate(name, seconds=1.0, tilt=(0.05, 0.0), pushes=push, model="contact") for name in ("lqr", "zero")]


def boxes(fig):
    """Boxes of legends and axes and of the page in pixels, once the figure is laid out."""
    fig.draw_without_rendering()
    return [legend.get_window_extent() for legend in fig.legends], [ax.get_window_extent() for ax in fig.axes], fig.bbox


@pytest.mark.parametrize("width", [None, 3.5])
def test_controllers_in_common_axes(width, moving):
    fig = overlay.draw(moving, width)
    assert [ax.get_ylabel() for ax in fig.axes] == list(overlay.QUANTITIES)
    for ax in fig.axes:
        looks = [(line.get_color(), line.get_linestyle()) for line in ax.lines[: len(moving)]]
        assert len({color for color, _ in looks}) == len({dashes for _, dashes in looks}) == len(moving)
    torque = fig.axes[4].lines[0]
    np.testing.assert_allclose(torque.get_ydata(), np.abs(moving[0].torques).max(axis=1))
    (legend,), axes, page = boxes(fig)
    assert not any(legend.overlaps(ax) for ax in axes)
    assert legend.x0 >= page.x0
    assert legend.x1 <= page.x1
    assert fig.legends[0].get_texts()[1].get_text() == f"no torque on contact, fell at {moving[1].fell_at:.2f} s"


def test_panels_have_letters_that_lie_on_nothing(moving):
    for fig in (trajectories.draw(moving), phase_portrait.draw(moving), overlay.draw(moving)):
        _, axes, page = boxes(fig)
        titles = [ax.title.get_window_extent() for ax in fig.axes if ax.title.get_text()]
        letters = [text for ax in fig.axes for text in ax.texts if text.get_text().startswith("(")]
        assert [text.get_text()[1] for text in letters] == list("abcdefghij"[: len(letters)])
        assert len(letters) >= 2
        for box in (letter.get_window_extent() for letter in letters):
            assert not any(box.overlaps(other) for other in (*axes, *titles))
            assert page.x0 <= box.x0 < box.x1 <= page.x1
            assert box.y1 <= page.y1 + 1


def test_a_pdf_has_its_letters_as_truetype(moving, tmp_path):
    save(phase_portrait.draw(moving), tmp_path / "f.pdf")
    written = (tmp_path / "f.pdf").read_bytes()
    assert b"/CIDFontType2" in written
    assert b"/Type3" not in written


def test_logarithmic_axes_within_a_few_decades_have_plain_numbers():
    fig = figure()
    wide, narrow = fig.subplots(1, 2)
    wide.semilogy([1e-9, 1.0])
    narrow.semilogy([0.015, 0.034])
    panels.finish(fig)
    fig.draw_without_rendering()
    assert [tick.get_text() for tick in narrow.get_yticklabels() if tick.get_text()][1:3] == ["0.015", "0.02"]
    assert any("10^" in tick.get_text() for tick in wide.get_yticklabels())


def test_the_command_draws_common_axes(tmp_path):
    what = [
        "--figure",
        "trajectories",
        "--overlay",
        "--seconds",
        "0.2",
        "--width",
        "89",
        "-o",
        str(tmp_path),
        "--quiet",
    ]
    assert main(["plot", "balance", "--controller", "lqr", "--controller", "pid", *what]) == 0
    assert "largest friction" in (tmp_path / "trajectories.svg").read_text(encoding="utf-8")
