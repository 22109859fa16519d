"""Tosses of `python -m validation.obstacle_tosses`; docs/obstacles.md has many."""

import pytest

import ballbot_rs as bb
from validation.obstacle_tosses import toss

#: Robots that were wedged in between floor and edges of obstacles, where wrong points of contact gave them energy.
WEDGED = [("kugle", 1, 1e-3)]


@pytest.mark.parametrize(
    ("preset", "seed", "sim_dt"),
    [*WEDGED, *((preset, seed, 5e-3) for preset in bb.Params.preset_names() for seed in range(4))],
)
def test_tossed_robots_gain_no_energy_and_stay_out_of_obstacles(preset, seed, sim_dt):
    result = toss(preset, seed, sim_dt)
    if result is None:
        pytest.skip("an obstacle is where the robot starts")
    gain, depth, unsolved = result
    assert gain < 0.01
    assert depth < 1e-3 or unsolved > 0
