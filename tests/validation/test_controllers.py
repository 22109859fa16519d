"""What the page on controllers measures is what it says."""

import numpy as np

import ballbot_rs as bb
from validation.controllers import TOPICS, limits, trials


def test_trials_end_at_the_first_failure():
    passed = np.array([[True, True, False], [False, True, False], [True, True, True]])
    np.testing.assert_array_equal(trials._first_failures(passed), [1.0, 3.0, 0.0])


def test_the_default_regulator_is_the_one_of_the_page():
    assert [topic.name for topic in TOPICS] == ["limits", "matrix", "presets"]
    tilt = trials.basin(bb.Lqr())
    expected = limits.BASIN
    assert abs(tilt.min() - expected) <= trials.RING
    assert tilt.min() > trials.basin(limits.VARIANTS["a largest torque alone"]).min() + 9.0
