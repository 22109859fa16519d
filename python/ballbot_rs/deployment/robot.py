"""The name of the robot that a header is for."""

from ballbot_rs._core import ROBOTS, Params


def robot_name(robot: Params) -> str:
    """The name of a preset in quotes, or a reference to the parameters of another robot."""
    preset = next((name for name in ROBOTS if Params.preset(name) == robot), None)
    return "with the parameters below" if preset is None else f"'{preset}'"
