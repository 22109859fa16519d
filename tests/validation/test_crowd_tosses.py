"""Tosses of `python -m validation.crowd_tosses`; docs/obstacles.md has many."""

import pytest

from validation.crowd_tosses import toss


@pytest.mark.parametrize(("count", "seed"), [*((2, seed) for seed in range(6)), (5, 13)])
def test_tossed_robots_gain_no_energy_and_stay_out_of_each_other(count, seed):
    result = toss(count, seed, 1e-3)
    if result is None:
        pytest.skip("robots overlap where they start")
    gain, depth, unlike, _ = result
    assert gain < 2e-3
    assert depth < 6e-3
    assert unlike < 1e-9
