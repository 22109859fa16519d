"""The training environment as policy files describe it."""

import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._core import ACTUATORS, ROBOTS, SENSORS, TASKS
from ballbot_rs.envs._batch_env import new_batch, resolved_options
from ballbot_rs.envs.own.stage import imported, split
from ballbot_rs.envs.registration import description_of, env_id_of, task_of

#: The best policy in the folder of a run whose policies are ONNX files.
BEST_OF_RUN: Final = "best_model.onnx"

#: Options of policies from before 0.2.0: these had no scaling, and this torque per unit of action.
BEFORE_SCALING: Final = {"scale_observations": False, "max_wheel_torque": 1.0}


def in_run(path: Path) -> Path:
    """The ONNX policy in a run's folder, if it has one; else the path itself."""
    return path / BEST_OF_RUN if (path / BEST_OF_RUN).is_file() else path


def task_in(file: Path, env_id: str, task: str | None) -> str:
    """The task of a policy file, from the environment's id in it; `task` is the requested task, if any.

    Raises:
        ValueError: it is for another task, or for an unknown task.
    """
    if task is None:
        try:
            return task_of(env_id)
        except ValueError:
            known = ", ".join(description["id"] for description in TASKS.values())
            raise ValueError(
                f"{file} was trained for another environment: env_id is {env_id!r}, expected one of "
                f"{known}; name a task in Python with the module or file that registers it, as FILE.py:{env_id}, or "
                "import that module first (ballbot --import MODULE COMMAND ...)"
            ) from None
    if env_id != env_id_of(task):
        raise ValueError(
            f"{file} was trained for another environment: env_id is {env_id!r}, expected {env_id_of(task)!r}"
        )
    return task


def observation_layout(task: str) -> list[list[Any]]:
    """Name, unit, bound, value at rest and typical magnitude of each row of an observation, as in JSON."""
    fields = ("name", "unit", "bound", "rest", "typical")
    return [[row[field] for field in fields] for row in description_of(task)["observation"]]


def metadata(task: str, options: Mapping[str, Any], algorithm: str, versions: Mapping[str, str]) -> dict[str, Any]:
    """The metadata of an ONNX policy.

    Args:
        task: name of the task.
        options: all options of the environment that the policy was trained in.
        algorithm: name of what trained it.
        versions: of further libraries.
    """
    return {
        "env_id": env_id_of(task),
        "env_options": dict(options),
        # The environment scales observations where `scale_observations` is set; the network does not scale them.
        "observation": observation_layout(task),
        # None with `scale_by_robot`: it follows from the robot.
        "max_wheel_torque": options["max_wheel_torque"],
        "control_dt": options["control_dt"],
        "algorithm": algorithm,
        "versions": {"ballbot_rs": __version__, **versions, "python": platform.python_version()},
    }


def fits(layout: Any, task: str) -> bool:
    """Whether a file's rows of an observation match a task. Before 0.2.0 they had no value at rest."""
    rows = observation_layout(task)
    return layout in (rows, [row[:3] for row in rows], [row[0] for row in rows])


def completed(task: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """All options of the environment that a policy was trained in, completed from the options in its file.

    Raises:
        ValueError: there is no such environment.
        TypeError: the task has no such option.
    """
    if isinstance(options.get("events"), str):
        raise ValueError(f"events = {options['events']!r}: a policy file has them as a list, not the name of a file")
    # As versions before 0.4 wrote it.
    options = {"robot" if name == "params" else name: value for name, value in options.items()}
    for name, known in (("actuators", ACTUATORS), ("sensors", SENSORS), ("robot", ROBOTS)):
        value = options.get(name)
        if isinstance(value, str) and value not in known:
            raise ValueError(f"{name} = {value!r}: a policy file has one of {', '.join(known)}, or all numbers")
    for option, functions in split(options)[1].items():
        for of, name in functions.items():
            module = str(name).partition(":")[0]
            # A file must not choose which code runs: only what its reader has imported, and made for this.
            if module.partition(".")[0] in sys.stdlib_module_names and module != "__main__":
                raise ValueError(f"{option}.{of} = {name!r} is not a function of robots")
            if module not in sys.modules:
                raise ValueError(
                    f"{option}.{of} = {name!r}: import {module} first (ballbot --import MODULE COMMAND ...)"
                )
            if getattr(imported(f"{option}.{of}", str(name)), "__module__", None) != module:
                raise ValueError(f"{option}.{of} = {name!r} is not of the module {module}")
    before = {} if "scale_observations" in options else BEFORE_SCALING
    # Where Gymnasium, not the environment, ended the episodes, the task's number of steps holds.
    given = {**before, **{name: value for name, value in options.items() if value is not None}}
    return resolved_options(new_batch(1, task=task, num_threads=1, options=given), given)
