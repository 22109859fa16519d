"""What the page on controllers measures is what it describes."""

import dataclasses

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from tests.support.paths import ROOT
from validation.controllers import TOPICS, law_figure, laws, limits, responses


@pytest.mark.slow("repeats a page")
def test_the_default_regulator_matches_the_page():
    assert [topic.name for topic in TOPICS] == ["choice", "limits", "matrix", "tunings", "presets"]
    # Every third direction.
    scenario = dataclasses.replace(load()["S2-rest"], directions=8)
    default, without = (
        run_scenarios(law, scenario)[0].score for law in (bb.Lqr(), limits.VARIANTS["only a torque limit"])
    )
    assert abs(default - limits.BASIN) <= 0.5
    assert default > without + 9.0


@pytest.mark.parametrize("law", bb.controllers())
def test_a_law_has_a_section_with_its_diagram_and_figure(law: str):
    page = (ROOT / "docs/laws.md").read_text(encoding="utf-8")
    (section,) = [part for part in page.split("\n## ") if part.startswith(f"`{law}`\n")]
    assert section.count("```mermaid\nflowchart LR\n") == 1
    assert section.count(f"](laws/{law}.svg)") == 1
    figure = (laws.FIGURES / f"{law}.svg").read_text(encoding="utf-8")
    assert len(figure.encode()) < 60_000
    assert "<image" not in figure
    assert "<text" in figure


@pytest.mark.slow("repeats a page")
def test_the_basin_of_a_figure_matches_the_tables():
    found = responses.measure("lqr").recovered
    edges = responses.RING * np.argmin(found, axis=0)
    assert abs(edges.min() - limits.BASIN) <= responses.RING
    assert not found[responses.TILTS > 52.0].any()


def test_a_searched_basin_matches_the_map(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(responses, "TILTS", np.arange(13.5, 24.0))
    map_ = responses._basin("pid")
    assert 0 < map_.sum(axis=0).min() < map_.sum(axis=0).max() < len(map_)
    monkeypatch.setattr(responses, "PLANNERS", ("pid",))
    np.testing.assert_array_equal(responses._basin("pid"), map_)


def test_ranges_of_tilts():
    assert law_figure._runs(np.array([True, True, False, True])) == [(0.0, 2.0), (3.0, 4.0)]
