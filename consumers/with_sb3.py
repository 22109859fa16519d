"""Stable-Baselines3's PPO on a `BallbotVecEnv` that its own `make_vec_env` makes."""

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

import ballbot_rs as bb
from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish


class UntilTimeIsOver(BaseCallback):
    """Ends a training of Stable-Baselines3 with the time."""

    def __init__(self, timer: Timer) -> None:
        super().__init__()
        self._timer = timer

    def _on_step(self) -> bool:
        return not self._timer.is_over


if __name__ == "__main__":
    timer = Timer()
    env = make_vec_env(ENV_ID, NUM_ENVS, seed=0, vec_env_cls=bb.BallbotVecEnv)
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=1024, n_epochs=5, gamma=0.98, learning_rate=1e-3, seed=0)
    model.learn(10**9, UntilTimeIsOver(timer))
    finish(model.num_timesteps, timer, lambda observations: model.predict(observations, deterministic=True)[0])
