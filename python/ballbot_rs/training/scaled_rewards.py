"""Rewards at the scale that the learner likes."""

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class ScaledRewards(VecEnvWrapper):
    """Multiplies rewards by a factor.

    PPO clips the gradients of policy and value together, and a value of some hundreds takes it long to reach.
    """

    def __init__(self, venv: VecEnv, factor: float) -> None:
        super().__init__(venv)
        self._factor = np.float32(factor)

    def reset(self) -> VecEnvObs:
        """As that of `venv`."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As that of `venv`, with scaled rewards."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, rewards * self._factor, dones, infos
