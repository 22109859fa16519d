"""Given actions in `Batch.rollout`: the motion is the motion of `step`."""

import numpy as np
import pytest

import ballbot_rs as bb

STEPS, N = 60, 11
ACTIONS = np.clip(np.random.default_rng(0).normal(0.0, 0.6, (STEPS, N, 3)), -1.0, 1.0)


def robots(**options):
    batch = bb.Batch(N, "balance", **options)
    batch.reset(seeds=range(N))
    return batch


@pytest.mark.parametrize("options", [{}, {"events": "hard", "actuators": {"delay": 0.02, "lag": 0.01}}])
def test_the_motion_is_the_same_as_step_by_step(options):
    by_rollout, by_steps = robots(**options), robots(**options)
    found = by_rollout.rollout(steps=STEPS, actions=ACTIONS, record=("states", "actions", "rewards", "terminated"))
    np.testing.assert_array_equal(found["actions"], ACTIONS.astype(np.float32))
    for step, actions in enumerate(ACTIONS):
        _, rewards, terminated, _ = by_steps.step(actions)
        np.testing.assert_array_equal(found["rewards"][step], rewards)
        np.testing.assert_array_equal(found["terminated"][step], terminated)
        np.testing.assert_array_equal(found["states"][step + 1], by_steps.states())
    assert found["terminated"].any(), "episodes end, and the next begin"


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (ACTIONS[:-1], ValueError, r"actions has shape \(59, 11, 3\), expected \(60, 11, 3\)"),
        (ACTIONS[:, :-1], ValueError, r"actions has shape \(60, 10, 3\)"),
        (ACTIONS[0], ValueError, r"actions has shape \(11, 3\)"),
        (np.broadcast_to(0.0, (10**9, N, 3)), ValueError, r"actions has shape \(1000000000, 11, 3\)"),
        (np.where(np.arange(STEPS)[:, None, None] == 7, np.nan, ACTIONS), ValueError, r"actions\[7, 0, 0\] = NaN"),
        ([["x"]], TypeError, "actions"),
    ],
)
def test_actions_that_cannot_be_applied_are_rejected(actions, error, message):
    batch = robots()
    with pytest.raises(error, match=message):
        batch.rollout(steps=STEPS, actions=actions)
    np.testing.assert_array_equal(batch.states(), robots().states())


def test_actions_exclude_setpoints():
    with pytest.raises(TypeError, match="one of controller, with setpoints and privileged, policies and actions"):
        robots().rollout(steps=STEPS, actions=ACTIONS, setpoints={"position": (0.0, 0.0)})
