"""rl-zoo3 on a `BallbotVecEnv`, with hyperparameters for every task.

    python -m ballbot_rs.training.rl_zoo3 --algo ppo --env ballbot/Goal-v0

The arguments are the same as for `rl_zoo3.train`. Its own command finds the hyperparameters by `--gym-packages
ballbot_rs --conf-file ballbot_rs.training.rl_zoo3`, and steps the robots one by one.
"""

import copy
import sys
from typing import Any, Final

from ballbot_rs._core import TASKS
from ballbot_rs.training.config import TrainConfig, load

#: Factor of the steps of tasks without a teacher: `ballbot train` continues until a policy succeeds, most seeds within
#: this factor, and rl-zoo3 does not.
_LONGEST: Final = 3

#: The task whose PPO arguments serve tasks that `ballbot train` begins with a teacher, which rl-zoo3 does not have.
_WITHOUT_TEACHER: Final = "balance"


def _hyperparameters(config: TrainConfig) -> dict[str, Any]:
    learner = config if config.teacher is None else load(_WITHOUT_TEACHER)[0]
    arguments = learner.arguments()
    for name in learner.schedule:
        arguments[name] = f"lin_{arguments[name]}"
    found: dict[str, Any] = {
        "n_timesteps": config.total_timesteps * (1 if config.teacher is not None else _LONGEST),
        "policy": "MlpPolicy",
        "n_envs": config.num_envs,
        "env_kwargs": dict(config.env),
        "policy_kwargs": dict(learner.policy),
        **arguments,
    }
    if config.reward_scale != 1.0:
        wrapper = "ballbot_rs.training.scaled_rewards.ScaledRewards"
        found["vec_env_wrapper"] = [{wrapper: {"factor": config.reward_scale}}]
    return found


_HYPERPARAMETERS: Final = {description["id"]: _hyperparameters(load(task)[0]) for task, description in TASKS.items()}

#: PPO arguments by the environment's id, from the configurations of `ballbot train`; a copy each time, as rl-zoo3
#: removes the arguments that it has used.
hyperparams: dict[str, dict[str, Any]]


def __getattr__(name: str) -> Any:
    if name == "hyperparams":
        return copy.deepcopy(_HYPERPARAMETERS)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def main() -> None:
    """Runs `rl_zoo3.train`."""
    from rl_zoo3.exp_manager import ExperimentManager
    from rl_zoo3.train import train

    from ballbot_rs.envs.sb3 import BallbotVecEnv

    ExperimentManager.default_vec_env_cls = BallbotVecEnv
    if not {"--conf-file", "-conf"} & set(sys.argv):
        # At the front: the user's last option may take any number of values.
        sys.argv[1:1] = ["--conf-file", __spec__.name if __spec__ is not None else __name__]
    train()


if __name__ == "__main__":
    main()
