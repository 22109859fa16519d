"""Resets from given states: what they sample, what they reject, and that a rejected state changes nothing."""

import numpy as np
import pytest

from ballbot_rs import BalanceEnv, BalanceVectorEnv, BallbotVecEnv, State

OPTIONS = {"model": "spatial", "max_episode_steps": 30}


@pytest.fixture
def leaning(paper):
    return State.at_rest(paper, tilt=(0.05, 0.0))


def test_the_episode_after_a_given_start_matches_a_single_environment(leaning):
    """A given start uses no random numbers, in a batch as in a single environment."""
    single = BalanceEnv(**OPTIONS)
    single.reset(seed=5, options={"state": leaning})
    expected, _ = single.reset()

    vector = BalanceVectorEnv(3, **OPTIONS)
    vector.reset(seed=5, options={"states": [leaning, None, leaning]})
    np.testing.assert_array_equal(vector.reset()[0][0], expected)

    sb3 = BallbotVecEnv(num_envs=3, **OPTIONS)
    sb3.seed(5)
    sb3.set_options([{"state": leaning}, {}, {}])
    sb3.reset()
    np.testing.assert_array_equal(sb3.reset()[0], expected)


def test_a_rejected_reset_changes_nothing(paper, leaning):
    env, twin = (BalanceVectorEnv(3, **OPTIONS) for _ in range(2))
    for e in (env, twin):
        e.reset(seed=1)
        e.step(np.full((3, 3), 0.1))
    sliding = State((0, 0, paper.ball_radius), ball_velocity=(1, 0, 0))
    rejected = [
        ({"states": [leaning]}, "3"),
        ({"states": [leaning, sliding, None]}, "without slip"),
        ({"reset_mask": np.ones(2, bool)}, r"\(3,\)"),
        ({"reset_mask": np.array([True, False, True]), "states": [None, leaning, None]}, "environment 1"),
    ]
    for options, message in rejected:
        with pytest.raises(ValueError, match=message):
            env.reset(seed=9, options=options)
    np.testing.assert_array_equal(env.states, twin.states)
    # Neither have the seeds been taken.
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_task_options_cannot_be_set_as_attributes():
    vector, sb3 = BalanceVectorEnv(2, **OPTIONS), BallbotVecEnv(num_envs=2, **OPTIONS)
    for name in ("reset_tilt", "max_wheel_torque", "scale_observations", "reward"):
        for env in (vector, sb3):
            with pytest.raises(AttributeError, match=f"{name} is fixed"):
                env.set_attr(name, 0.3)


def test_call_rejects_unknown_methods_of_an_environment():
    env = BalanceVectorEnv(2, **OPTIONS)
    env.reset(seed=0)
    assert len(env.call("state")) == 2
    assert env.call("reward_terms")[0]["alive"] == 0.0
    for name, arguments in (("reset", ()), ("render", ()), ("state", (1,)), ("num_envs", (1,))):
        with pytest.raises(AttributeError, match=f"no method '{name}'"):
            env.call(name, *arguments)


def test_a_robot_may_be_named_by_its_preset():
    assert BalanceEnv(robot="kugle", max_wheel_torque=1.5).params.body_mass == pytest.approx(16.154)
    with pytest.raises(ValueError, match="unknown robot preset 'kugel'"):
        BalanceEnv(robot="kugel")
    for name in ("params", "sim_dt"):
        with pytest.raises(TypeError, match=name):
            BalanceEnv(**{name: None})
