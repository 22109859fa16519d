"""rl-zoo3 by its command line: one rollout of every task, then a training that learns."""

import sys
import tempfile
from pathlib import Path

from rl_zoo3 import exp_manager
from stable_baselines3 import PPO

from ballbot_rs.training import rl_zoo3
from consumers.common import Timer, finish
from consumers.with_sb3 import UntilTimeIsOver

LEARNED = "ballbot/Balance-v0"


def train(env_id, folder, steps, timer=None):
    """Trains by the command line, without its evaluations; the callback ends it."""
    create = exp_manager.ExperimentManager.create_callbacks

    def with_timer(manager):
        create(manager)
        if timer is not None:
            manager.callbacks.append(UntilTimeIsOver(timer))

    exp_manager.ExperimentManager.create_callbacks = with_timer
    sys.argv = ["rl_zoo3", "--algo", "ppo", "--env", env_id, "-n", str(steps), "-f", str(folder), "--seed", "0"]
    sys.argv += ["--eval-freq", "-1", "--num-threads", "1", "--log-interval", "1000", "--device", "cpu"]
    try:
        rl_zoo3.main()
    finally:
        exp_manager.ExperimentManager.create_callbacks = create
    return max(Path(folder).rglob(f"{env_id.replace('/', '-')}.zip"), key=lambda path: path.stat().st_mtime)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for env_id, settings in rl_zoo3.hyperparams.items():
            PPO.load(train(env_id, folder, settings["n_envs"] * settings["n_steps"]))
        timer = Timer()
        model = PPO.load(train(LEARNED, folder, 280_000, timer))
        finish(
            model.num_timesteps,
            timer,
            lambda observations: model.predict(observations, deterministic=True)[0],
            f"{len(rl_zoo3.hyperparams)} tasks with hyperparameters",
        )
