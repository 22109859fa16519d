"""Forces from outside over time from Python: environments, and copies."""

import copy
import pickle

import numpy as np
import pytest

import ballbot_rs as bb

SINE = {"frequency": 4.0, "phase": 0.3, "duration": 0.5}


def _run(env, steps=20):
    for _ in range(steps):
        env.step(np.zeros(env.action_space.shape, np.float32))
    return env


@pytest.mark.parametrize("model", ["contact", "spatial", "rigid"])
def test_copies_of_an_environment_keep_the_force(model):
    env = bb.BalanceEnv(model=model)
    env.reset(seed=3)
    env.apply_force((1.0, -0.5, 0.0), (0.0, 0.0, 0.2), **SINE)
    _run(env, 7)
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    _run(env)
    for other in others:
        assert _run(other).state == env.state
    plain = bb.BalanceEnv(model=model)
    plain.reset(seed=3)
    assert _run(plain, 27).state != env.state


def test_a_reset_ends_the_force():
    env = bb.BalanceEnv(model="contact")
    env.reset(seed=3)
    env.apply_force((2.0, 0.0, 0.0))
    env.reset(seed=4)
    other = bb.BalanceEnv(model="contact")
    other.reset(seed=4)
    assert _run(env).state == _run(other).state


def test_a_force_on_one_robot_of_a_vector_environment():
    def moved(**index):
        envs = bb.BalanceVectorEnv(3, model="contact", num_threads=1)
        envs.reset(seed=1)
        if index:
            envs.apply_force((1.0, 0.0, 0.0), **index)
        for _ in range(10):
            envs.step(np.zeros((3, 3), np.float32))
        return envs.states

    plain, one, each = moved(), moved(index=1), moved(index=None)
    assert [bool((plain[i] == one[i]).all()) for i in range(3)] == [True, False, True]
    assert (one[1] == each[1]).all()
    assert not (plain[0] == each[0]).all()


def test_events_apply_forces():
    events = [{"term": "force", "at": 0.02, "range": [0.5, 1.0], "height": 0.1, "frequency": 2.0, "duration": 0.3}]
    batch = bb.Batch(2, "balance", model="contact", events=events)
    batch.reset()
    for _ in range(10):
        batch.step(np.zeros((2, 3)))
    force, azimuth, height = batch.draws(0)["force"]
    assert 0.5 <= force <= 1.0
    assert height == 0.1
    robot = bb.Batch(2, "balance", model="contact")
    robot.reset()
    for step in range(10):
        if step == 2:
            vector = (force * np.cos(azimuth), force * np.sin(azimuth), 0.0)
            robot.apply_force(0, vector, (0.0, 0.0, 0.1), frequency=2.0, duration=0.3)
        robot.step(np.zeros((2, 3)))
    assert (robot.states()[0] == batch.states()[0]).all()
    assert batch.push_count(0) == 0


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ({"frequency": -1.0}, "frequency = -1"),
        ({"op": "add"}, "op of a force is 'abs'"),
        ({"direction": [1, 2]}, "direction"),
        ({"term": "push", "frequency": 2.0}, "frequency is only for the term 'force'"),
        ({"term": "body_mass", "height": 1.0}, "height is only for the terms 'push' and 'force'"),
    ],
)
def test_wrong_events_are_named(event, message):
    given = {"term": "force", "at": 0.0, "range": [1.0, 2.0], **event}
    with pytest.raises(ValueError, match=message):
        bb.Batch(1, "balance", events=[given])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 4e-4}, "duration = 0.0004 is out of range: it must be 0, or at least 0.0005 s"),
        ({"phase": 1.0}, "phase = 1 is out of range: it must be 0 rad, as a constant force has no phase"),
        ({"frequency": 501.0}, "frequency = 501"),
        ({"delay": -1.0}, "delay = -1"),
    ],
)
def test_a_wrong_force_leaves_the_former_one(options, message):
    robots = [bb.Ballbot(model="contact") for _ in range(2)]
    for robot in robots:
        robot.apply_force((1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=message):
        robots[0].apply_force((2.0, 0.0, 0.0), **options)
    for robot in robots:
        robot.step(np.zeros(3), 10)
    assert robots[0].state == robots[1].state


def test_the_estimate_belongs_to_the_law_that_acts():
    batch = bb.Batch(2, "balance", model="contact")
    batch.reset()
    observed = bb.Controller("lqr", lean_observer=4.0)
    for _ in range(20):
        batch.step(batch.control(observed))
    assert np.isfinite(batch.outside_forces()).all()
    batch.step(batch.control(observed, drawn=True))
    assert batch.outside_forces() is None
    batch.step(batch.control(observed))
    assert np.isfinite(batch.outside_forces()).all()
