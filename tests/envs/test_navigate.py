"""The navigate task: goals among posts, guides, collisions."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import TASKS

NAMES = [metric["name"] for metric in TASKS["navigate"]["metrics"]]


def metric(batch, name):
    return batch.metrics()[:, NAMES.index(name)]


def driven(steps, robots=16, law="lqr", **options):
    batch = bb.Batch(robots, "navigate", seed=3, autoreset="disabled", max_episode_steps=steps, **options)
    controller = bb.Controller(law, batch.params(0), batch.control_dt)
    batch.reset()
    for _ in range(steps):
        batch.step(batch.control(controller))
    return batch


@pytest.mark.parametrize("robot", bb.Params.preset_names())
def test_a_barrier_leads_every_preset_to_its_goals_without_a_collision(robot):
    found = bb.evaluate("lqr", task="navigate", episodes=48, robot=robot)
    assert found.success_rate >= 0.95
    assert found.metrics["collisions"] == 0.0


def test_a_straight_way_collides_and_guides_do_not():
    collisions = [
        bb.evaluate("lqr", task="navigate", episodes=64, guide=guide).metrics["collisions"] for guide in range(3)
    ]
    assert collisions[0] > 0.1
    assert collisions[1:] == [0.0, 0.0]


def test_goals_are_free_and_near_enough():
    batch = bb.Batch(64, "navigate", seed=1)
    batch.reset()
    goals, balls = batch.command(), batch.states()[:, :2]
    distances = np.linalg.norm(goals - balls, axis=1)
    terrain = batch.terrain
    radius = batch.params(0).ball_radius
    assert ((distances >= 1.0) & (distances <= 3.0)).mean() > 0.95
    assert np.asarray(terrain.obstacle_distance(*goals.T)).min() > radius + 0.1


def test_guided_motions_keep_their_distance():
    """The least distance of an upright robot from an obstacle is the guide's margin, less what the robot is behind."""
    batch = driven(2000, guide=2)
    assert (metric(batch, "collisions") == 0.0).all()
    assert metric(batch, "clearance").min() > 0.05


def test_collisions_are_counted_once_each():
    """A robot that is driven against a wall touches it; a success has no collision."""
    wall = {"kind": "plane", "slope": 0.0, "obstacles": [{"kind": "wall", "x": 0.6, "yaw": np.pi}]}
    batch = bb.Batch(
        1, "navigate", autoreset="disabled", terrain=wall, guide=0, goal_distance=(0.0, 0.0), max_episode_steps=1500
    )
    batch.reset(starts=[bb.State.at_rest(batch.params(0))])
    batch.set_command(0, [1.0, 0.0])
    law = bb.Controller("lqr", batch.params(0), batch.control_dt)
    for _ in range(1500):
        batch.step(batch.control(law))
    assert metric(batch, "collisions")[0] >= 1.0
    success, _ = batch.endings()
    assert not success.any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"guide": 1.5}, "guide"),
        ({"guide": 3}, "guide"),
        ({"approach": 3.0}, "approach = 3"),
        ({"goal_distance": (2.0, 1.0)}, "goal_distance"),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        bb.Batch(1, "navigate", **options)
