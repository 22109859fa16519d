"""The clients: their programs, and what their environments need."""

import dataclasses
from typing import Final


@dataclasses.dataclass(frozen=True)
class Client:
    """A learner of others."""

    name: str
    #: Its program in this folder, and its file in `requirements`.
    program: str
    #: Which environment it steps.
    through: str


CLIENTS: Final = (
    Client("Gymnasium", "gymnasium", "`make_vec`, no learner"),
    Client("Stable-Baselines3", "sb3", "`make_vec_env(vec_env_cls=BallbotVecEnv)`, PPO"),
    Client("sb3-contrib", "sb3_contrib", "`BallbotVecEnv`, TRPO"),
    Client("rl-zoo3", "rl_zoo3", "`BallbotVecEnv`, PPO"),
    Client("PPO in one file (CleanRL)", "cleanrl_style", "`make_vec`, same_step"),
    Client("SBX", "sbx", "`BallbotVecEnv`, PPO"),
    Client("TorchRL", "torchrl", "`make_vec`, same_step, PPO"),
    Client("skrl", "skrl", "`make_vec`, next_step, PPO"),
    Client("Tianshou", "tianshou", "adapter of `BallbotVectorEnv`, disabled, PPO"),
    Client("rsl-rl", "rsl_rl", "adapter of `BallbotVectorEnv`, same_step, PPO"),
    Client("RLlib", "rllib", "`make_vec` by id, PPO"),
    Client("PufferLib", "pufferlib", "adapter of `BallbotVectorEnv`, same_step, PuffeRL"),
    Client("Minari", "minari", "`DataCollector(record_infos=True)`, linear regression"),
)
