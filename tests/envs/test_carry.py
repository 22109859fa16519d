"""The carry task: the goal task with a glass of water. tests/envs/test_reward_terms.py recomputes the water."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs._text_table import print_table

ALIKE = {
    "goal_distance": (0.5, 1.5),
    "goal_seconds": (4.0, 5.0),
    "goal_radius": 0.05,
    "approach_acceleration": 0.3,
    "approach_time": 0.5,
    "hold_seconds": 1.0,
    "reset_tilt": 0.05,
}


def driven(task, steps=900, robot="paper", **options):
    """A batch of `task` under LQR, at the end of its episodes."""
    batch = bb.Batch(6, task, seed=5, autoreset="disabled", robot=robot, max_episode_steps=steps, **options)
    lqr = bb.Lqr(batch.params(0), batch.control_dt)
    batch.reset()
    for _ in range(steps):
        batch.step(batch.control(lqr))
    return batch


def metrics(batch, name):
    names = [metric["name"] for metric in TASKS[batch.task]["metrics"]]
    return batch.metrics()[:, names.index(name)]


def test_robots_move_as_in_the_goal_task():
    goal, carry = driven("goal", **ALIKE), driven("carry", **ALIKE)
    np.testing.assert_array_equal(carry.states(), goal.states())
    for name in ("goals_held", "time_ratio"):
        np.testing.assert_array_equal(metrics(carry, name), metrics(goal, name))


def test_water_that_spills_costs_the_success():
    for freeboard, spilled in ((1e-6, 1.0), (10.0, 0.0)):
        batch = driven("carry", **ALIKE, freeboard=freeboard)
        np.testing.assert_array_equal(metrics(batch, "spilled"), spilled)
        success, reasons = batch.endings()
        np.testing.assert_array_equal(success, np.full(6, not spilled))
        assert not reasons.any()


def test_a_glass_at_rest_is_still():
    batch = bb.Batch(1, "carry", autoreset="disabled", robot="paper", goal_distance=(0.0, 0.0))
    batch.reset(starts=[bb.State.at_rest(batch.params(0))])
    lqr = bb.Lqr(batch.params(0), batch.control_dt)
    for _ in range(100):
        batch.step(batch.control(lqr))
    assert metrics(batch, "slosh")[0] < 1e-9


@pytest.mark.parametrize("name", ["glass_height", "slosh_frequency", "slosh_damping", "glass_radius"])
def test_the_glass_changes_its_water(name):
    plain = metrics(driven("carry", 300, **ALIKE), "slosh")
    low = {"glass_height": 0.1, "slosh_frequency": 1.5, "slosh_damping": 0.5, "glass_radius": 0.02}
    assert (metrics(driven("carry", 300, **ALIKE, **{name: low[name]}), "slosh") != plain).all()


def test_a_table_of_its_metrics_has_the_names_of_the_laws(capsys):
    print_table(bb.compare(["lqr", "hierarchical_sliding_mode"], task="carry", episodes=2), "carry", {})
    out = capsys.readouterr().out
    assert "\nlqr " in out
    assert "…al_sliding_mode " in out


def test_water_on_a_floor_that_moves_is_rejected():
    with pytest.raises(ValueError, match="the water of the task carry: floor_acceleration"):
        bb.Batch(1, "carry", robot=bb.Params.paper().replace(floor_acceleration=(0.5, 0.0)))


def test_water_as_thick_as_honey_comes_to_rest():
    batch = bb.Batch(1, "carry", slosh_frequency=100.0, slosh_damping=2.0, control_dt=0.1, sim_dt=0.002)
    batch.reset(starts=[bb.State.at_rest(batch.params(0))])
    for _ in range(3):
        batch.step(np.zeros((1, 3)))
    assert metrics(batch, "slosh")[0] < 1e-6
