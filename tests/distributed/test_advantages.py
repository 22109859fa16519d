"""Advantages of many fragments at once agree with the sum, step by step."""

import numpy as np
import pytest

from ballbot_rs.training.on_ray.advantages import advantages, joined, without_last

GAMMA, LAMBDA = 0.97, 0.9


@pytest.mark.parametrize("lengths", [[1], [5], [7, 1, 4, 7, 2]])
def test_advantages_are_the_sum_of_discounted_errors(lengths):
    rng = np.random.default_rng(sum(lengths))
    terminated = [bool(i % 2) for i in range(len(lengths))]
    rewards = [rng.standard_normal(n).astype(np.float32) for n in lengths]
    values = [rng.standard_normal(n + 1).astype(np.float32) for n in lengths]
    expected = []
    for reward, value, is_over in zip(rewards, values, terminated, strict=True):
        following = value[1:].astype(float)
        following[-1] *= not is_over
        errors = reward + GAMMA * following - value[:-1]
        weights = (GAMMA * LAMBDA) ** np.arange(len(reward))
        expected += [float(errors[i:] @ weights[: len(reward) - i]) for i in range(len(reward))]
    found, targets = advantages(joined(rewards), joined(values), lengths, terminated, gamma=GAMMA, gae_lambda=LAMBDA)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(targets, expected + np.concatenate([value[:-1] for value in values]), atol=1e-5)


def test_the_last_observation_of_a_fragment_has_no_action():
    assert without_last([2, 1]).tolist() == [True, True, False, True, False]
