"""Scenarios at the points of a sweep: other robots, models, motors and numbers of the scenario."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Final

from ballbot_rs._core import Params
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._robot import params_of
from ballbot_rs.analysis.sweep import FLAG, Point
from ballbot_rs.envs.parts import apply
from ballbot_rs.scenarios.scenario import Axis, Scenario, types

#: Fields of a scenario that may be swept.
FIELDS: Final = tuple(name for name, kind in types().items() if kind in (float, int, float | None, Axis))

#: Names that a sweep may have in addition to parameters of the robot.
NAMES: Final = ("robot", "model", "actuators", *FIELDS)


def at_point(
    point: Point, names: Mapping[str, str], scenarios: Sequence[Scenario], params: Params, model: str
) -> tuple[list[Scenario], Params, str]:
    """Scenarios, robot and model at a point of a sweep.

    Args:
        point: its values by name.
        names: as `full_names` returns them.
        scenarios: at all points.
        params: of the robot, unless the sweep has it.
        model: of the robot, unless the sweep has it.

    Raises:
        ValueError: an invalid value, or an option that has no parts.
    """
    values = {names[name]: value for name, value in point.items()}
    changes = {name: values.pop(name) for name in FIELDS if name in values}
    model = values.pop("model", model)
    motors = {name: value for name, value in values.items() if name.startswith("actuators.")}
    robot = {name: value for name, value in values.items() if name.partition(".")[0] == "robot"}
    if unknown := values.keys() - motors.keys() - robot.keys():
        raise InvalidInputError(f"{unknown.pop()}: expected a part, as actuators.delay")
    found = params_of(apply(robot, {}, {"robot": params.to_dict()}, FLAG).get("robot", params))
    changed = [
        dataclasses.replace(
            one, **changes, actuators=apply(motors, {}, {"actuators": one.actuators}, FLAG)["actuators"]
        )
        if motors
        else dataclasses.replace(one, **changes)
        for one in scenarios
    ]
    return changed, found, model
