"""Options of environments by name, of which a dot names a part: `actuators.delay`, `robot.body_mass`."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import INSTRUMENTS, PARAMETERS, Params, load_actuators, load_sensors
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import renamed
from ballbot_rs._robot import params_of
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.family import are_several, is_family, is_list
from ballbot_rs.envs.own.stage import FUNCTION_OPTIONS
from ballbot_rs.envs.registration import DEFAULT_TASK

#: What begins the messages of errors, unless another source of the options is named.
FLAG: Final = "--set"

#: Parameters of a robot.
PARAMETER_NAMES: Final = tuple(one["name"] for one in PARAMETERS)


def one_robot(robot: Any) -> Params:
    """The parameters that the option `robot` of an environment names or holds."""
    if are_several(robot):
        raise ValueError("robot: expected one robot, not several")
    return params_of(robot)


def _robot_table(robot: Any) -> dict[str, Any]:
    """The parts of the option `robot`: parameters, or the keys of a family."""
    if is_family(robot):
        return dict(robot)
    if is_list(robot):
        raise ValueError("robot: a list of robots has no parts")
    return one_robot(robot).to_dict()


def _changed(head: str, table: dict[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """The table of an option with other values of some parts."""
    if head != "robot" or is_family(table):
        return {**table, **parts}
    if "family" in parts:
        return dict(parts)
    return Params(**table).replace(**parts).to_dict()


#: Options that have parts, with a function for the table of an option that is given by name or in full.
_TABLES: Final[Mapping[str, Callable[[Any], dict[str, Any]]]] = {
    "robot": _robot_table,
    "actuators": lambda motors: dict(load_actuators(motors) if isinstance(motors, str) else motors or {}),
    "sensors": lambda sensors: dict(load_sensors(sensors) if isinstance(sensors, str) else sensors or {}),
    "terrain": lambda terrain: {"kind": terrain} if isinstance(terrain, str) else dict(terrain or {}),
    **{option: lambda parts: dict(parts or {}) for option in (*INSTRUMENTS, *FUNCTION_OPTIONS)},
}


def apply(
    values: Mapping[str, Any],
    options: Mapping[str, Any],
    base: Mapping[str, Any] | Callable[[], Mapping[str, Any]],
    flag: str = FLAG,
) -> dict[str, Any]:
    """Options of an environment, overridden by values of the command line or of a sweep.

    Args:
        values: by name; a dot names a part of an option, `actuators.delay`.
        options: options that other arguments name.
        base: the options whose parts are overridden where neither `options` nor `values` have the whole; a function is
            called if there are such parts.
        flag: begins the messages of errors.

    Raises:
        ValueError: an option given twice, an option without parts, or invalid parameters of a robot.
    """
    found = dict(options)
    parts: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, dot, part = name.partition(".")
        if dot:
            parts.setdefault(head, {})[part] = value
        elif name in options:
            raise ValueError(f"{flag} {name}={value}: {name} is also given by a separate argument")
        else:
            found[name] = value
        if name == "robot.family" and "robot" in options:
            raise ValueError(f"{flag} {name}={value}: a robot is also given by a separate argument")
        if dot and head not in _TABLES:
            known = ", ".join(f"{one}.NAME" for one in _TABLES)
            raise ValueError(f"{flag} {name}={value}: '{head}' has no parts: expected one of {known}")
    for head, changes in parts.items():
        if head not in found:
            base = base() if callable(base) else base
            found[head] = base.get(head)
        try:
            found[head] = _changed(head, _TABLES[head](found[head]), changes)
        except InvalidInputError as error:
            raise InvalidInputError(f"{flag} {head}: {error}") from error
        except (TypeError, ValueError) as error:
            raise ValueError(f"{flag} {error}") from error
    return found


def check_names(
    names: Iterable[str],
    task: str | None,
    others: Sequence[str] = (),
    flag: str = FLAG,
    parts: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Checks names of options.

    Args:
        names: the names; of a name with a dot, the part before it.
        task: whose options are known; None if a policy decides the task: then only parameters of robots are rejected.
        others: other known names.
        flag: begins the messages of errors.
        parts: names of parts of other options, with the option before a dot, for the message of an error.

    Raises:
        ValueError: an unknown name; the message has the closest known one.
    """
    known = (*option_names(task or DEFAULT_TASK), *others)
    for name in (name.partition(".")[0] for name in names):
        better = renamed(name, known) or as_part(name)
        if name in known or (task is None and not better):
            continue
        part = f": did you mean '{parts[name]}'?" if name in parts else ""
        close = part or better or did_you_mean(name, known) or f": expected one of {', '.join(known)}"
        raise ValueError(f"{flag} {name}: unknown option '{name}'{close}")


def as_part(name: str) -> str:
    """The hint that a name is a parameter of the robot."""
    return f": did you mean 'robot.{name}'?" if name in PARAMETER_NAMES else ""
