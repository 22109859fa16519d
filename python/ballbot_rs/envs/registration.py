"""The tasks, the ids of their environments, and their registration with Gymnasium."""

from typing import Final

import gymnasium

from ballbot_rs._checks import did_you_mean

BALANCE: Final = "ballbot/Balance-v0"

#: Ids of the environments by the name of their task.
TASKS: Final = {"balance": BALANCE}
DEFAULT_TASK: Final = "balance"

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


def env_id_of(task: str) -> str:
    """The environment's id of a task.

    Raises:
        ValueError: there is no such task.
    """
    if task not in TASKS:
        raise ValueError(f"unknown task '{task}': expected one of {', '.join(TASKS)}{did_you_mean(task, TASKS)}")
    return TASKS[task]


def task_of(env_id: str) -> str:
    """The task of an environment's id.

    Raises:
        ValueError: it is no environment of this package.
    """
    for task, known in TASKS.items():
        if env_id == known:
            return task
    raise ValueError(f"unknown environment '{env_id}': expected {', '.join(TASKS.values())}")
