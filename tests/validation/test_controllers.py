"""What the page on controllers measures is what it says."""

import dataclasses

import ballbot_rs as bb
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from validation.controllers import TOPICS, limits


def test_the_default_regulator_is_the_one_of_the_page():
    assert [topic.name for topic in TOPICS] == ["limits", "matrix", "tunings", "presets"]
    # Every third direction.
    scenario = dataclasses.replace(load()["S2-rest"], directions=8)
    default, without = (
        run_scenarios(law, scenario)[0].score for law in (bb.Lqr(), limits.VARIANTS["a largest torque alone"])
    )
    assert abs(default - limits.BASIN) <= 0.5
    assert default > without + 9.0
