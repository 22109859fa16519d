"""The factor of the learner's rewards."""

import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor

from ballbot_rs.envs.sb3 import BallbotVecEnv
from ballbot_rs.training import config
from ballbot_rs.training.scaled_rewards import ScaledRewards


def test_the_learner_gets_scaled_rewards_and_its_log_the_rewards_of_the_task():
    options = {"model": "spatial", "num_threads": 1, "max_episode_steps": 20, "seed": 4}
    plain, scaled = (VecMonitor(BallbotVecEnv(3, **options)) for _ in range(2))
    scaled = ScaledRewards(scaled, 0.25)
    np.testing.assert_array_equal(plain.reset(), scaled.reset())
    ends = 0
    for _ in range(25):
        expected, found = plain.step(np.zeros((3, 3))), scaled.step(np.zeros((3, 3)))
        np.testing.assert_array_equal(found[0], expected[0])
        np.testing.assert_allclose(found[1], 0.25 * expected[1], rtol=1e-6)
        for info, other in zip(found[3], expected[3], strict=True):
            if "episode" in other:
                ends += 1
                assert info["episode"]["r"] == other["episode"]["r"]
    assert ends >= 3


@pytest.mark.parametrize("value", ["0", "-1.0", "inf", "nan", "true", "1e-60", "5e38", '"a"'])
def test_an_invalid_factor_is_rejected(value):
    with pytest.raises(ValueError, match=r"reward_scale = .* must be from 1e-6 to 1e6"):
        config.parse(f"reward_scale = {value}", "test")
