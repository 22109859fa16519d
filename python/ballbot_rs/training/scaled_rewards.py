"""Rewards at a scale that suits the learner."""

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class ScaledRewards(VecEnvWrapper):
    """Multiplies rewards by a factor.

    PPO clips the gradients of policy and value together, so that it takes long to learn a value of some hundreds.
    """

    def __init__(self, venv: VecEnv, factor: float) -> None:
        super().__init__(venv)
        self._factor = np.float32(factor)

    def reset(self) -> VecEnvObs:
        """As `venv.reset`."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As `venv.step_wait`, with scaled rewards."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, rewards * self._factor, dones, infos
