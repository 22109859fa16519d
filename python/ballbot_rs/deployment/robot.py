"""The robot that a header is for."""

from ballbot_rs._core import ROBOTS, Params
from ballbot_rs._errors import InvalidInputError


def robot_of(params: Params | str | None) -> Params:
    """A robot, from the name of a preset, or None for the paper's.

    Raises:
        ValueError: neither of them, or an unknown name.
    """
    if isinstance(params, Params):
        return params
    if params is not None and not isinstance(params, str):
        raise InvalidInputError(f"params = {params!r}: expected a robot or the name of a preset")
    return Params.preset("paper" if params is None else params)


def robot_name(robot: Params) -> str:
    """The name of a preset in quotes, or a reference to the parameters of another robot."""
    preset = next((name for name in ROBOTS if Params.preset(name) == robot), None)
    return "with the parameters below" if preset is None else f"'{preset}'"
