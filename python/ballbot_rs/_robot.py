"""The one way from what names a robot to its parameters."""

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias

from ballbot_rs._core import Params

#: What names a robot: its parameters, the name of a preset, the path of a TOML file, or parameters by name.
Robot: TypeAlias = Params | str | PathLike[str] | Mapping[str, Any]


def params_of(robot: Robot | None) -> Params:
    """The parameters of a robot; None is the paper's.

    Raises:
        TypeError: something else.
        ValueError: an unknown preset or parameter, a number out of range, or a malformed file.
        OSError: the file cannot be read.
    """
    if robot is None:
        return Params.paper()
    if isinstance(robot, Params):
        return robot
    if isinstance(robot, Mapping):
        return Params(**robot)
    if not isinstance(robot, (str, PathLike)):
        expected = "Params, the name of a preset, the path of a TOML file or a dict of parameters"
        raise TypeError(f"robot must be {expected}, not {type(robot).__name__}")
    return Params.from_toml(Path(robot)) if Path(robot).suffix == ".toml" else Params.preset(fspath(robot))
