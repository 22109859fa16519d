"""The tasks, the ids of their environments, and their registration with Gymnasium."""

from collections.abc import Mapping
from typing import Any, Final

import gymnasium

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import TASKS
from ballbot_rs.envs.own import registry, source
from ballbot_rs.envs.own.task import Task

DEFAULT_TASK: Final = "balance"

#: Prefix of an id with which Gymnasium imports the package first.
PREFIX: Final = "ballbot_rs:"


def register_environments() -> None:
    """Registers the environment of every task of the core, once."""
    for name, task in TASKS.items():
        if task["id"] not in gymnasium.registry:
            _register(name, task["id"], task)


def _register(name: str, env_id: str, task: Mapping[str, Any]) -> None:
    gymnasium.register(
        env_id,
        entry_point="ballbot_rs.envs.gymnasium_env:without_own_limit",
        vector_entry_point="ballbot_rs.envs.vector_env:of_task",
        max_episode_steps=task["max_episode_steps"],
        reward_threshold=task["reward_threshold"],
        kwargs={"task": name},
    )


def register(env_id: str, task: type[Task], **options: Any) -> None:
    """Registers a task in Python with Gymnasium, by its id, and with every front end and command.

    ```python
    class Slow(bb.Task):
        base = "balance"

        def reward(self, robots):
            return -np.linalg.norm(robots.velocity, axis=1)

    bb.register("me/Slow-v0", Slow, robot="kugle")
    env = bb.BallbotVectorEnv(16, task="me/Slow-v0")
    ```

    Registering an id again replaces its task, in notebooks for example.

    Args:
        env_id: for example "me/Spin-v0".
        task: a subclass of `Task`.
        options: of its environments and of the constructor of `task`, in place of their defaults.

    Raises:
        TypeError: `task` is not a subclass of `Task`.
        ValueError: the id belongs to a task of the core, or Gymnasium does not accept it; the base of `task` is not a
            task of the core; an argument of the constructor of `task` has the name of an option of environments.
    """
    from ballbot_rs.envs._batch_env import new_batch, options_of_own_tasks

    before, spec = registry.find(env_id), gymnasium.registry.get(env_id)
    try:
        registry.add(env_id, task, options, options_of_own_tasks, lambda: new_batch(1, task=env_id, num_threads=1))
        gymnasium.registry.pop(env_id, None)
        _register(env_id, env_id, registry.description_of(env_id))
    except BaseException as error:
        registry.restore(env_id, before)
        if spec is not None:
            gymnasium.registry[env_id] = spec
        if isinstance(error, gymnasium.error.Error):
            raise ValueError(f"'{env_id}' is not the id of an environment: {error}") from error
        raise


def description_of(task: str) -> Mapping[str, Any]:
    """The entry of `TASKS` for a task of the core, or its equivalent for a task in Python."""
    return TASKS[task] if task in TASKS else registry.description_of(task)


def known_tasks() -> tuple[str, ...]:
    """The tasks of the core, and the registered tasks in Python."""
    return (*TASKS, *registry.ids())


def geometry_of(task: str) -> str | None:
    """What the command of a task is in space: "velocity", "point" or "curve"; "impulse" for pushes; None otherwise."""
    geometry: str | None = description_of(task)["geometry"]
    return geometry


def class_of(task: str, front_end: str) -> type[Any] | None:
    """The class of a task of the core, `BalanceEnv` of "balance" and "Env"; None for tasks of others."""
    import ballbot_rs.envs.tasks as tasks

    name = TASKS[task]["id"].partition("/")[2].rpartition("-")[0] if task in TASKS else ""
    found: type[Any] | None = getattr(tasks, f"{name}{front_end}", None) if name else None
    return found


def name_of(task: str) -> str:
    """The name of a task from its name or its id, which may begin with `ballbot_rs:`.

    The id of a task in Python may begin with the module or file that registers it, "my_module:me/Spin-v0" or
    "my_task.py:me/Spin-v0", which is imported.

    Raises:
        TypeError: it is not a string.
        ValueError: there is no such task, or the module or file cannot be imported or does not register it.
    """
    if not isinstance(task, str):
        raise TypeError(f"task must be the name of a task, not {type(task).__name__}")
    task = task.removeprefix(PREFIX)
    if source.is_in_source(task):
        return source.id_in_source(task)
    for name, known in TASKS.items():
        if task == known["id"]:
            return name
    env_id_of(task)
    return task


def env_id_of(task: str) -> str:
    """The environment's id of a task.

    Raises:
        ValueError: there is no such task.
    """
    if registry.find(task) is not None:
        return task
    if task not in TASKS:
        known = known_tasks()
        raise ValueError(f"unknown task '{task}': expected one of {', '.join(known)}{did_you_mean(task, known)}")
    return TASKS[task]["id"]


def task_of(env_id: str) -> str:
    """The task of an environment's id, which may begin with `ballbot_rs:`.

    Raises:
        ValueError: it is not an environment of this package.
    """
    env_id = env_id.removeprefix(PREFIX)
    if registry.find(env_id) is not None:
        return env_id
    ids = {task["id"]: name for name, task in TASKS.items()}
    if env_id not in ids:
        raise ValueError(f"unknown environment '{env_id}': expected {', '.join(ids)}")
    return ids[env_id]
