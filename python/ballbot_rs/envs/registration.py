"""The environments' ids, and their registration with Gymnasium."""

from typing import Final

import gymnasium

BALANCE: Final = "ballbot/Balance-v0"

#: Environments by the name that the command line gives their task.
TASKS: Final = {"balance": BALANCE}

#: Length of an episode at the default control rate: 10 s.
MAX_EPISODE_STEPS: Final = 1000

#: Mean return of a policy that counts as having solved the task; the best possible is 1000.
REWARD_THRESHOLD: Final = 950.0


def register_environments() -> None:
    """Registers every environment of this package, once."""
    if BALANCE not in gymnasium.registry:
        gymnasium.register(
            BALANCE,
            entry_point="ballbot_rs.envs.gymnasium_env:without_time_limit",
            vector_entry_point="ballbot_rs.envs.vector_env:BalanceVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
            reward_threshold=REWARD_THRESHOLD,
        )


def check_id(env_id: str) -> None:
    """Raises ValueError unless `env_id` is an environment of this package."""
    if env_id != BALANCE:
        raise ValueError(f"unknown environment '{env_id}': expected {BALANCE}")
