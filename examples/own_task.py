"""Your own task: turn in place at 2 rad/s, learned with PPO. Commands take it as examples/own_task.py:me/Spin-v0."""

import sys

import numpy as np

import ballbot_rs as bb


class Spin(bb.Task):
    """Three methods of arrays over all robots; docs/own_tasks.md has the rest."""

    def observe(self, robots):
        place = np.column_stack([robots.yaw_rate / 2, robots.velocity, robots.ball_position[:, :2]])
        return np.column_stack([10 * robots.gravity[:, :2], robots.body_rate, robots.wheel_speeds / 5, place])

    def reward(self, robots):
        return 1.0 - np.abs(robots.yaw_rate - 2.0) / 2 - np.linalg.norm(robots.velocity, axis=1)

    def terminated(self, robots):
        return robots.tilt > 0.4


bb.register("me/Spin-v0", Spin, max_episode_steps=500)

if __name__ == "__main__":
    from stable_baselines3 import PPO

    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 400_000
    env = bb.BallbotVecEnv("me/Spin-v0", num_envs=64, stagger=True, seed=0)
    settings = {"n_steps": 64, "batch_size": 2048, "gamma": 0.98, "learning_rate": 1e-3}
    model = PPO("MlpPolicy", env, **settings, policy_kwargs={"log_std_init": -1.0}, seed=0)
    model.learn(steps)
    bb.save(model, "spin.zip")
    for result in bb.compare(["spin.zip", "zero"], task="me/Spin-v0", episodes=20):
        print(f"{result.controller}: upright {result.survival_rate:.0%}, mean reward {result.mean_reward:.3f}")
