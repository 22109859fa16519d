"""Costs: each is exactly the crossing of its limit, and Safety-Gymnasium's interface has their sum."""

import gymnasium
import numpy as np
import pytest

import ballbot_rs as bb

ID = "ballbot_rs:ballbot/Velocity-v0"
LIMITS = {"max_traction": 0.15, "max_speed": 0.2}


def run(env):
    found = [env.reset(seed=1)]
    over = False
    while not over:
        found.append(env.step(np.array([0.3, -0.1, 0.2], dtype=np.float32)))
        over = found[-1][-2] or found[-1][-3]
    return found


def test_costs_are_crossings_of_their_limits():
    env = bb.CostInfo(gymnasium.make(ID), **LIMITS)
    robot = env.unwrapped
    _, info = env.reset(seed=1)
    assert info["cost"] == 0.0
    seen, over = [], False
    while not over:
        _, _, terminated, truncated, info = env.step(np.array([0.3, -0.1, 0.2], dtype=np.float32))
        assert info["cost_fall"] == terminated
        assert info["cost_traction"] == (robot._batch.contacts(0).friction_utilization.max() > LIMITS["max_traction"])
        assert info["cost_speed"] == (np.linalg.norm(robot.state.ball_velocity[:2]) > LIMITS["max_speed"])
        assert info["cost"] == info["cost_fall"] + info["cost_traction"] + info["cost_speed"]
        seen.append([info[f"cost_{name}"] for name in ("fall", "traction", "speed")])
        over = terminated or truncated
    assert (np.ptp(seen, axis=0) == 1.0).all()


def test_the_rest_is_the_environment():
    plain, costly, safe = (run(wrap(gymnasium.make(ID))) for wrap in (lambda env: env, bb.CostInfo, bb.SafetyEnv))
    assert len(plain) == len(costly) == len(safe)
    for one, five, six in zip(plain[1:], costly[1:], safe[1:], strict=True):
        observation, reward, cost, *others, info = six
        np.testing.assert_array_equal(observation, one[0])
        assert [reward, *others] == list(one[1:4])
        assert cost == info["cost"]
        assert info == five[4]
        assert {key: info[key] for key in one[4]} == one[4]


def test_recorders_and_vectors_take_the_costs():
    many = gymnasium.vector.SyncVectorEnv([lambda: bb.CostInfo(gymnasium.make(ID))] * 2)
    many.reset(seed=0)
    *_, infos = many.step(np.zeros((2, 3), dtype=np.float32))
    assert infos["cost"].shape == (2,)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bb.CostInfo(gymnasium.make("Pendulum-v1")), "not an environment of one robot"),
        (lambda: bb.CostInfo(gymnasium.make(ID), max_speed=-1.0), "max_speed = -1.0 is out of range"),
        (lambda: bb.SafetyEnv(gymnasium.make(ID), max_traction=2.0), "max_traction = 2.0 is out of range"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
