"""Robots and their motors, from a name or a file."""

from pathlib import Path
from typing import Any, Final

from ballbot_rs import _toml
from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import ACTUATORS, ROBOTS, Params, load_actuators
from ballbot_rs._reading import read_regular

#: Largest file of parameters, bytes.
MAX_ROBOT_FILE: Final = 1 << 20

#: Tables of a robot's file in addition to its parameters.
STAGES: Final = ("actuators", "sensors")


def robot_option(name: str) -> Any:
    """The option `robot` of an environment for a preset's name or a TOML file.

    Raises:
        ValueError: a malformed file, or an unknown parameter.
        OSError: the file cannot be read.
    """
    if Path(name).suffix != ".toml":
        known = ROBOTS
        if name not in known:
            hint = did_you_mean(name, known)
            raise ValueError(f"unknown robot '{name}': expected one of {', '.join(known)}, or FILE.toml{hint}")
        return name
    try:
        table = _table(name)
        # `own_stages` reads these.
        for part in STAGES:
            if isinstance(table.get(part), dict):
                del table[part]
        return Params(**table).to_dict()
    except (ValueError, TypeError) as error:
        raise ValueError(f"{name}: {error}") from error


def own_stages(name: str | None) -> dict[str, str]:
    """The robot's file as `actuators` and `sensors`, as far as it has these tables: they apply unless others are named.

    The motors and sensors of a preset apply only where they are named.
    """
    if name is None or Path(name).suffix != ".toml":
        return {}
    table = _table(name)
    return {stage: name for stage in STAGES if isinstance(table.get(stage), dict)}


def own_motors(name: str, actuators: str | None) -> Any:
    """The options of the motors of `--actuators`, else of the robot's own file; None are ideal motors."""
    chosen = actuators or own_stages(name).get("actuators")
    return None if chosen is None else load_actuators(chosen)


def _table(name: str) -> dict[str, Any]:
    return _toml.loads(read_regular(Path(name), MAX_ROBOT_FILE).decode())


def actuators_option(name: str) -> Any:
    """The option `actuators` of an environment for a name, or for a TOML file or a URDF, whose numbers it holds.

    Raises:
        ValueError: a malformed file, or an unknown option.
        OSError: the file cannot be read.
    """
    if Path(name).suffix in (".toml", ".urdf"):
        return load_actuators(name)
    if name not in ACTUATORS:
        known = f"{', '.join(ACTUATORS)}, FILE.toml, or FILE.urdf"
        raise ValueError(f"unknown actuators '{name}': expected one of {known}{did_you_mean(name, ACTUATORS)}")
    return name
