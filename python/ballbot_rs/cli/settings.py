"""`--set NAME=VALUE`: options of the task, the robot and the training, spelled alike in every command."""

import argparse
import contextlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import INSTRUMENTS, Params, load_actuators, load_sensors
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.family import are_several, is_family, is_list
from ballbot_rs.envs.own.stage import FUNCTION_OPTIONS
from ballbot_rs.envs.registration import DEFAULT_TASK

FLAG: Final = "--set"

#: Text after `--set` in messages and in `--help`.
EXAMPLES: Final = "control_dt=0.005, actuators.delay=0.01, params.body_mass=2.5"


def add_to(command: Any, what: str = f"an option of the environment, or a part of one, as {EXAMPLES}") -> None:
    """Adds `--set`."""
    command.add_argument(FLAG, action="append", default=[], metavar="NAME=VALUE", help=f"{what}; repeat for more")


def params_of(robot: Any) -> Params:
    """The parameters that the option `params` of an environment names or holds."""
    if are_several(robot):
        raise ValueError("params: expected one robot, not several")
    return Params.preset(robot) if isinstance(robot, str) else Params(**robot)


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
    return values


def _robot_table(robot: Any) -> dict[str, Any]:
    """The parts of the option `params`: parameters, or the keys of a family."""
    if is_family(robot):
        return dict(robot)
    if is_list(robot):
        raise ValueError(f"{FLAG} params: a list of robots has no parts")
    return params_of("paper" if robot is None else robot).to_dict()


def _changed(head: str, table: dict[str, Any], part: str, value: Any) -> dict[str, Any]:
    """The table of an option with another value of a part."""
    if head != "params" or is_family(table):
        return {**table, part: value}
    return {part: value} if part == "family" else changed_robot(Params(**table), {part: value})


#: Options that have parts, with a function for the table of an option that is given by name or in full.
_TABLES: Final[Mapping[str, Callable[[Any], dict[str, Any]]]] = {
    "params": _robot_table,
    "actuators": lambda motors: dict(load_actuators(motors) if isinstance(motors, str) else motors or {}),
    "sensors": lambda sensors: dict(load_sensors(sensors) if isinstance(sensors, str) else sensors or {}),
    "terrain": lambda terrain: {"kind": terrain} if isinstance(terrain, str) else dict(terrain or {}),
    **{option: lambda parts: dict(parts or {}) for option in (*INSTRUMENTS, *FUNCTION_OPTIONS)},
}


def apply(
    values: Mapping[str, Any], options: Mapping[str, Any], base: Mapping[str, Any] | Callable[[], Mapping[str, Any]]
) -> dict[str, Any]:
    """Options of an environment, overridden by values of the command line.

    Args:
        values: by name; a dot names a part of an option, `actuators.delay`.
        options: options that other arguments name.
        base: the options whose parts are overridden where neither `options` nor `values` have the whole; a function is
            called if there are such parts.

    Raises:
        ValueError: an option given twice, an option without parts, or invalid parameters of a robot.
    """
    found = dict(options)
    for name, value in values.items():
        if "." not in name:
            if name in options:
                raise ValueError(f"{FLAG} {name}={value}: {name} is also given by a separate argument")
            found[name] = value
    # A family comes first, as it changes the parts.
    for name, value in sorted(values.items(), key=lambda item: item[0] != "params.family"):
        head, dot, part = name.partition(".")
        if not dot:
            continue
        if name == "params.family" and "params" in options:
            raise ValueError(f"{FLAG} {name}={value}: a robot is also given by a separate argument")
        if head not in _TABLES:
            known = ", ".join(f"{one}.NAME" for one in _TABLES)
            raise ValueError(f"{FLAG} {name}={value}: '{head}' has no parts: expected one of {known}")
        if head not in found:
            base = base() if callable(base) else base
            found[head] = base.get(head)
        table = _TABLES[head](found[head])
        found[head] = _changed(head, table, part, value)
    return found


def changed_robot(params: Params, values: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a robot with some of them replaced.

    Raises:
        ValueError: an unknown parameter, or invalid parameters.
    """
    try:
        return params.replace(**values).to_dict()
    except TypeError as error:
        raise ValueError(f"{FLAG} params: {error}") from error


def robot_of(arguments: argparse.Namespace, robot: Any) -> Params:
    """The robot of a command that has no environments, where `--set` only changes parameters."""
    values = assignments(arguments.set)
    for name, value in values.items():
        if not name.startswith("params."):
            raise ValueError(f"{FLAG} {name}={value}: expected params.NAME=VALUE{_as_part(name)}")
    return Params(**_TABLES["params"](apply(values, {"params": robot}, {})["params"]))


def check_names(names: Iterable[str], task: str | None, others: Sequence[str] = ()) -> None:
    """Checks names of options.

    Args:
        names: the names; of a name with a dot, the part before it.
        task: whose options are known; None if a policy decides the task: then only parameters of robots are rejected.
        others: other known names.

    Raises:
        ValueError: an unknown name; the message has the closest known one.
    """
    known = (*option_names(task or DEFAULT_TASK), *others)
    for name in (name.partition(".")[0] for name in names):
        if name in known or (task is None and not _as_part(name)):
            continue
        close = _as_part(name) or did_you_mean(name, known) or f": expected one of {', '.join(known)}"
        raise ValueError(f"{FLAG} {name}: unknown option '{name}'{close}")


def _as_part(name: str) -> str:
    """The hint that a name is a parameter of the robot."""
    parameters = Params.paper().to_dict()
    if name in parameters:
        return f": did you mean 'params.{name}'?"
    return ""
