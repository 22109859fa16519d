"""`--set NAME=VALUE`: options of the task, the robot and the training, spelled alike in every command."""

import argparse
import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from ballbot_rs._core import Params
from ballbot_rs.cli.options.numbers import in_si
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.parts import FLAG, PARAMETER_NAMES, apply, as_part, check_names, one_robot
from ballbot_rs.envs.registration import DEFAULT_TASK

__all__ = [
    "EXAMPLES",
    "FLAG",
    "add_to",
    "apply",
    "assignments",
    "check_names",
    "of_environments",
    "of_robots",
    "one_robot",
    "robot_of",
    "value_of",
]

#: Text after `--set` in messages and in `--help`.
EXAMPLES: Final = "control_dt=0.005, actuators.delay=0.01, robot.body_mass=2.5"


def add_to(
    command: Any,
    what: str = f"an option of the environment, or a part of one, in SI units and rad, e.g. {EXAMPLES}",
    keys: Callable[[], Mapping[str, str]] = dict,
) -> None:
    """Adds `--set`.

    Args:
        command: the parser to add it to.
        what: its help.
        keys: names that might be taken for options, with what `--set` calls them.
    """
    command.settings = keys
    command.add_argument(FLAG, action="append", default=[], metavar="NAME=VALUE", help=f"{what}; repeat for more")


def of_robots() -> dict[str, str]:
    """The parameters of a robot, as keys of `--set`."""
    return {name: f"robot.{name}" for name in PARAMETER_NAMES}


def of_environments() -> dict[str, str]:
    """The options of an environment and the parameters of its robot, as keys of `--set`."""
    return {**of_robots(), **{name: name for name in option_names(DEFAULT_TASK)}}


def value_of(text: str) -> Any:
    """A value of the command line: true, false or a list as in JSON, a number, otherwise text."""
    for read in (json.loads, float):
        with contextlib.suppress(ValueError):
            return read(text)
    return text


def assignments(given: Sequence[str], flag: str = FLAG) -> dict[str, Any]:
    """Values by name, from texts NAME=VALUE."""
    values = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise ValueError(f"{flag} {text}: expected NAME=VALUE")
        values[name] = value_of(value)
        if isinstance(values[name], str) and (number := in_si(value)) is not None:
            raise ValueError(f"{flag} {text}: values are in SI units and rad, without the unit: {name}={number:.6g}")
    return values


def robot_of(arguments: argparse.Namespace, robot: Any) -> Params:
    """The robot of a command that has no environments, where `--set` only changes parameters."""
    values = assignments(arguments.set)
    for name, value in values.items():
        if not name.startswith("robot."):
            raise ValueError(f"{FLAG} {name}={value}: expected robot.NAME=VALUE{as_part(name)}")
    return one_robot(apply(values, {"robot": robot}, {})["robot"])
