"""PPO of SBX, in JAX, on a `BallbotVecEnv` as it is: no scaling, no choice of the initialization."""

from sbx import PPO

import ballbot_rs as bb
from consumers.common import NUM_ENVS, ROLLOUT, Timer, finish
from consumers.with_sb3 import UntilTimeIsOver

if __name__ == "__main__":
    timer = Timer()
    env = bb.BallbotVecEnv(NUM_ENVS, seed=0)
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=1024, n_epochs=5, gamma=0.98, learning_rate=1e-3, seed=0)
    model.learn(10**9, UntilTimeIsOver(timer))
    finish(model.num_timesteps, timer, lambda observations: model.predict(observations, deterministic=True)[0])
