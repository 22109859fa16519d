"""The tasks, the ids of their environments, and their registration with Gymnasium."""

from typing import Final

import gymnasium

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import TASKS

DEFAULT_TASK: Final = "balance"


def register_environments() -> None:
    """Registers the environment of every task of the core, once."""
    for name, task in TASKS.items():
        if task["id"] not in gymnasium.registry:
            gymnasium.register(
                task["id"],
                entry_point="ballbot_rs.envs.gymnasium_env:without_own_limit",
                vector_entry_point="ballbot_rs.envs.vector_env:BallbotVectorEnv",
                max_episode_steps=task["max_episode_steps"],
                reward_threshold=task["reward_threshold"],
                kwargs={"task": name},
            )


def env_id_of(task: str) -> str:
    """The environment's id of a task.

    Raises:
        ValueError: there is no such task.
    """
    if task not in TASKS:
        raise ValueError(f"unknown task '{task}': expected one of {', '.join(TASKS)}{did_you_mean(task, TASKS)}")
    return TASKS[task]["id"]


def task_of(env_id: str) -> str:
    """The task of an environment's id.

    Raises:
        ValueError: it is no environment of this package.
    """
    ids = {task["id"]: name for name, task in TASKS.items()}
    if env_id not in ids:
        raise ValueError(f"unknown environment '{env_id}': expected {', '.join(ids)}")
    return ids[env_id]
