"""Tuning: a search that improves, repeats itself, and rejects what it cannot search."""

import pytest

from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import Scenario
from ballbot_rs.scenarios.tune import mean_ratio, tune, with_options

LINE = Scenario(
    "line", "", seconds=5.0, reference={"kind": "line", "goal": [1.0, 0.0], "seconds": 3.1}, score="rms_error"
)


def test_tuning_improves_and_repeats_itself():
    options = ["position", "velocity"]
    found = tune("lqr", LINE, 30, options=options, seed=1)
    assert found.cost < 0.9
    assert list(found.options) == options
    assert len(found.history) == 30
    assert all(after <= before for before, after in zip(found.history, found.history[1:], strict=False))
    assert tune("lqr", LINE, 30, options=options, seed=1) == found
    first, second = run_scenarios(["lqr", found.source()], [LINE])
    assert second.score / first.score == pytest.approx(found.cost, rel=1e-9)


def test_a_single_option():
    assert tune("lqr", LINE, 10, options=["position"]).cost <= 1.0


def test_costs_of_the_same_baseline_can_be_compared():
    plain, by_lqr = (tune("lqi", LINE, 1, baseline=name) for name in (None, "lqr"))
    first, second = run_scenarios(["lqr", "lqi"], [LINE])
    assert plain.cost == 1.0
    assert by_lqr.cost == pytest.approx(second.score / first.score, rel=1e-12)


def test_default_scenarios_do_not_depend_on_the_heading():
    found = tune("sliding_mode", budget=2)
    assert "surface" in found.options
    assert not any(name.startswith("yaw") for name in found.options)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nothing",), "tune takes a controller of the core"),
        (("lqr", LINE, 0), "budget"),
        (("pid", LINE, 5), "no score"),
        (("lqr", ["S4", "S4"], 5), "have the same id"),
    ],
)
def test_controllers_that_cannot_be_tuned_are_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        tune(*arguments)
    with pytest.raises(ValueError, match="not 'nothing'"):
        tune("lqr", LINE, 5, baseline="nothing")
    with pytest.raises(ValueError, match="no option"):
        tune("lqr", LINE, 5, options=["mass"])


def test_rejected_options_have_the_largest_cost():
    with pytest.raises(ValueError, match="out of range"):
        run_scenarios([with_options("lqr", {"position": -1.0})], [LINE])


def test_a_skipped_scenario_does_not_affect_the_cost():
    still = Scenario("still", "", seconds=0.5, tilt=2.0, score="rms_tilt")
    outcomes = run_scenarios("pid", [still, LINE])
    assert [one.skipped is None for one in outcomes] == [True, False]
    assert mean_ratio(outcomes, {"still": 0.5 * outcomes[0].score, LINE.id: 1.0}) == pytest.approx(2.0)
