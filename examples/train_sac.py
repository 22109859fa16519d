"""Train SAC, save the policy with its task, and compare it with LQR."""

import sys

from stable_baselines3 import SAC

import ballbot_rs as bb

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 180_000

env = bb.BallbotVecEnv(16, seed=0)
model = SAC(
    "MlpPolicy",
    env,
    learning_rate=1e-3,
    gamma=0.98,
    batch_size=256,
    train_freq=8,  # of 16 robots: 128 new steps
    gradient_steps=64,
    learning_starts=2000,
    ent_coef="auto_0.02",
    policy_kwargs={"net_arch": [64, 64]},
    seed=0,
)
model.learn(steps)
bb.save(model, "sac.zip")  # for evaluate, record, plot, view and export
for result in bb.compare(["sac.zip", "lqr"], episodes=50):
    print(f"{result.controller}: success {result.success_rate:.0%}, mean reward {result.mean_reward:.3f}")
