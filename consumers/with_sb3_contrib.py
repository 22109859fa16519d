"""TRPO of sb3-contrib on a `BallbotVecEnv`."""

from sb3_contrib import TRPO

import ballbot_rs as bb
from consumers.common import NUM_ENVS, ROLLOUT, Timer, finish
from consumers.with_sb3 import UntilTimeIsOver

if __name__ == "__main__":
    timer = Timer()
    env = bb.BallbotVecEnv(NUM_ENVS, seed=0)
    model = TRPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=1024, gamma=0.98, target_kl=0.02, seed=0)
    model.learn(10**9, UntilTimeIsOver(timer))
    finish(model.num_timesteps, timer, lambda observations: model.predict(observations, deterministic=True)[0])
