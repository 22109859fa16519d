"""The one way from what names a robot to its parameters."""

from collections.abc import Mapping
from os import PathLike
from typing import Any, TypeAlias

from ballbot_rs._core import Params, _params_of

#: What names a robot: its parameters, the name of a preset, the path of a TOML file, or parameters by name.
Robot: TypeAlias = Params | str | PathLike[str] | Mapping[str, Any]


def params_of(robot: Robot | None) -> Params:
    """The parameters of a robot; None is the paper's.

    Raises:
        TypeError: something else.
        ValueError: an unknown preset or parameter, a number out of range, or a malformed file.
        OSError: the file cannot be read.
    """
    return Params.paper() if robot is None else _params_of(robot)
