"""Observations in groups, for multi-input policies of Stable-Baselines3."""

from typing import Any

from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from ballbot_rs.envs.grouped import FloatArray, Groups
from ballbot_rs.envs.sb3 import BallbotVecEnv


class GroupedVecEnv(VecEnvWrapper):
    """A `BallbotVecEnv` whose observations are dicts: `state`, and the robots' instruments by name.

    ```python
    env = bb.GroupedVecEnv(bb.BallbotVecEnv(8, terrain="wave", scan={"points": (3, 3)}))
    print(env.reset()["scan"].shape)
    ```

    `PPO("MultiInputPolicy", GroupedVecEnv(env))` learns from it.
    """

    def __init__(self, venv: BallbotVecEnv) -> None:
        self._groups = Groups(venv.observation_space, venv.observation_layout)
        super().__init__(venv, observation_space=self._groups.space)

    def reset(self) -> dict[str, FloatArray]:
        """As `BallbotVecEnv.reset`."""
        observations: Any = self.venv.reset()
        return self._groups.split(observations)

    def step_wait(self) -> VecEnvStepReturn:
        """As `BallbotVecEnv.step_wait`; `terminal_observation` in the infos is also a dict."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for info in infos:
            if "terminal_observation" in info:
                info["terminal_observation"] = self._groups.split(info["terminal_observation"])
        return self._groups.split(observations), rewards, dones, infos  # type: ignore[arg-type]
