"""Steps whose motion is from outside: the task's results."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import _state_rows as rows
from ballbot_rs._core import TASKS

SHORT = {"model": "contact", "max_episode_steps": 30}


class Outside:
    """The robots of a batch as separate `Ballbot`s."""

    def __init__(self, batch):
        self.batch = batch
        self.robots = [
            bb.Ballbot(batch.params(i), model=batch.model, sim_dt=batch.sim_dt, terrain=batch.terrain)
            for i in range(batch.num_envs)
        ]
        self.torques, self.steps = None, batch.substeps

    def step(self, actions):
        self.torques = np.clip(actions, -1.0, 1.0).astype(float) * self.batch.max_wheel_torque
        return self.batch.step_with(actions, self.motion)

    def motion(self, states, pushes):
        moved = []
        for robot, row, push, torques in zip(self.robots, states, pushes, self.torques, strict=True):
            robot.reset(bb.State.from_array(row))
            robot.push(push[:3])
            # The pushes of tasks are at the center of mass.
            assert not push[3:].any()
            robot.step(torques, steps=self.steps)
            moved.append(robot.state.to_array())
        return np.array(moved)


def actions(step, n):
    return 0.2 * np.sin(np.arange(3 * n).reshape(n, 3) * 7 + 3 * step).astype(np.float32)


# Other engines reject riders.
@pytest.mark.slow("another engine")
@pytest.mark.parametrize("task", sorted(TASKS.keys() - {"ride"}))
@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_the_same_motion_gives_the_same_step(task, mode):
    options = {**SHORT, "push_seconds": (0.1, 0.1)} if task == "push" else SHORT
    inside = bb.Batch(3, task, autoreset=mode, seed=5, **options)
    outside = Outside(bb.Batch(3, task, autoreset=mode, seed=5, **options))
    np.testing.assert_array_equal(inside.reset(), outside.batch.reset())
    ends = 0
    for step in range(70):
        given = actions(step, 3)
        expected, found = inside.step(given), outside.step(given)
        # The solver of a robot that is placed again has lost the forces of its warm start.
        np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=1e-6)
        np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-6)
        np.testing.assert_array_equal(found[2], expected[2])
        np.testing.assert_array_equal(found[3], expected[3])
        np.testing.assert_allclose(outside.batch.command(), inside.command(), rtol=0, atol=1e-6)
        ends += int(found[3].sum())
    assert ends >= 3
    np.testing.assert_allclose(outside.batch.metrics(), inside.metrics(), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_a_state_that_is_not_finite_ends_only_its_episode(model):
    batch = bb.Batch(3, autoreset="disabled", seed=1, model=model)
    batch.reset()

    def motion(states, _):
        moved = states.copy()
        moved[1] = np.nan
        return moved

    observations, rewards, terminated, truncated = batch.step_with(np.zeros((3, 3), np.float32), motion)
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert batch.ending(1) == (False, "diverged")
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_pushes_off_the_center_of_mass_are_given_with_their_moment(model):
    batch = bb.Batch(1, seed=1, model=model)
    batch.reset(starts=[bb.State.at_rest(batch.params(0), (0.1, 0.05), 0.4)])
    impulses, points = np.array([[0.1, -0.2, 0.05], [0.0, 0.1, 0.1]]), np.array([[0.05, 0.0, 0.2], [0.0, -0.1, 0.1]])
    for impulse, point in zip(impulses, points, strict=True):
        batch.push(0, impulse, point)
    axes = rows.body_axes_of(batch.states())[0].T
    moment = np.cross((points - batch.params(0).body_com) @ axes, impulses).sum(axis=0)
    given = []

    def motion(states, pushes):
        given.append(pushes[0])
        return states

    batch.step_with(np.zeros((1, 3), np.float32), motion)
    batch.step_with(np.zeros((1, 3), np.float32), motion)
    np.testing.assert_allclose(given[0], [*impulses.sum(axis=0), *moment], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(given[1], np.zeros(6))


def test_quaternions_have_unit_length():
    batch = bb.Batch(2, seed=1)
    batch.reset()

    def motion(states, _):
        states[1, rows.BODY_QUATERNION] *= 2.0
        return states

    with pytest.raises(ValueError, match=r"length of body_quaternion of robot 1 = 2.*1 within 1e-6"):
        batch.step_with(np.zeros((2, 3), np.float32), motion)


@pytest.mark.parametrize("model", ["planar", "spatial"])
def test_models_without_slip_are_rejected(model):
    batch = bb.Batch(1, seed=1, model=model)
    batch.reset()
    with pytest.raises(ValueError, match=f"the model {model} cannot hold a state with slip"):
        batch.step_with(np.zeros((1, 3), np.float32), lambda states, _: states)
    batch.step(np.zeros((1, 3), np.float32))


def test_states_that_do_not_match_the_robots_are_rejected():
    batch = bb.Batch(2, seed=1)
    batch.reset()
    with pytest.raises(ValueError, match=r"states .*\(2, 32\)|states"):
        batch.step_with(np.zeros((2, 3), np.float32), lambda states, _: states[:1])
    with pytest.raises(ValueError, match="reset all environments"):
        batch.step(np.zeros((2, 3), np.float32))
    batch.reset()
    batch.step(np.zeros((2, 3), np.float32))


def test_what_the_motion_raises_is_raised():
    batch = bb.Batch(2, seed=1)
    batch.reset()

    def motion(*_):
        raise LookupError("no engine")

    with pytest.raises(LookupError, match="no engine"):
        batch.step_with(np.zeros((2, 3), np.float32), motion)
    with pytest.raises(ValueError, match="reset all environments"):
        batch.step(np.zeros((2, 3), np.float32))


def test_the_motion_cannot_use_the_batch_that_waits_for_it():
    batch = bb.Batch(1, seed=1)
    batch.reset()
    with pytest.raises(RuntimeError, match="being used"):
        batch.step_with(np.zeros((1, 3), np.float32), lambda *_: batch.states())
