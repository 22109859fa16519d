"""A feedback law as a C99 header."""

import math
from typing import Any, Final

import numpy as np

from ballbot_rs import __version__
from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import CONTROLLERS, Controller, Params
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.catalog import make_controller
from ballbot_rs.deployment.c_text import comment, constants, guarded, included, is_piece, piece
from ballbot_rs.deployment.robot import robot_name

#: The controllers that can be written as C: those with a part of their name in the folder `c`.
CONTROLLERS_IN_C: Final = tuple(filter(is_piece, CONTROLLERS))

#: Options that give a law memory that the C lacks.
NOT_IN_C: Final = ("delay", "lean_observer", "adaptation")

#: Parts of a setpoint in the C.
SETPOINT_PARTS: Final = ("position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate", "tilt")


def controller_header(
    name: str,
    robot: Robot | None = None,
    control_dt: float | None = None,
    *,
    max_wheel_torque: float | None = None,
    **options: Any,
) -> str:
    """The text of a C99 header with a controller for one robot.

    Args:
        name: one of `CONTROLLERS_IN_C`.
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        control_dt: as in `Controller`.
        max_wheel_torque: a torque limit in addition to the controller's, N·m, as the option of an environment.
        options: as in `Controller`.

    Raises:
        ValueError: a controller that cannot be written as C, or a number out of range.
        TypeError: an option that the controller does not have.
    """
    if name not in CONTROLLERS_IN_C:
        known = ", ".join(CONTROLLERS_IN_C)
        hint = did_you_mean(name, CONTROLLERS_IN_C)
        raise ValueError(f"the controller '{name}' cannot be written as C: expected one of {known}{hint}")
    robot = params_of(robot)
    law = make_controller(name, robot, control_dt, **options)
    given = {**options, **(options.get("scaled") or {})}
    for option in NOT_IN_C:
        if np.any(given.get(option, 0.0)):
            raise ValueError(
                f"{option} = {given[option]} of the controller '{name}' cannot be written as C: it must be 0"
            )
    if max_wheel_torque is not None:
        # The limit of the environment applies in addition, as in a batch.
        options["max_torque"] = _least(law.constants()["max_torque"], max_wheel_torque)
        law = make_controller(name, robot, control_dt, **options)
    if unknown := sorted(set(law.setpoint_parts) - set(SETPOINT_PARTS)):
        raise ValueError(
            f"the controller '{name}' follows {', '.join(unknown)} of a setpoint, which the C does not have"
        )
    found: dict[str, Any] = law.constants()
    limits = "limits_of_traction" if "traction_rows" in found else "limits_of_cap"
    barrier = "barrier" if "barrier_tests" in found else "no_barrier"
    values: dict[str, Any] = {"pi": math.pi, "control_dt": law.control_dt, "ball_radius": robot.ball_radius}
    values |= {"ball_rate_of_wheels": _ball_rate_of_wheels(robot)} | found
    pieces = dict.fromkeys(
        ("state", "roll", "pose", "limited", limits, *included(barrier), barrier, *included(name), name)
    )
    body = "\n".join((piece("real"), "/* ---- Constants, SI units. */\n\n" + constants(values), *map(piece, pieces)))
    return guarded("controller", name, comment(_head(name, law, robot, options, found)), body)


def _least(first: Any, second: Any) -> float:
    if isinstance(second, bool) or not isinstance(second, (int, float)):
        raise ValueError(f"max_wheel_torque is {second!r}, expected a number")
    # The controller rejects NaN.
    return float(first) if first < second else float(second)


def _ball_rate_of_wheels(robot: Params) -> np.ndarray[Any, Any]:
    """Rate of the ball relative to the body, body frame, per speed of each wheel without slip (3 × 3)."""
    # Laws with traction scaling have the geometry of the wheels.
    wheels: dict[str, Any] = Controller("pid", robot, traction=True).constants()
    rates: np.ndarray[Any, Any] = np.linalg.inv(wheels["surface"]) * wheels["wheel_radius"]
    return rates


def _saturation(found: dict[str, Any]) -> list[str]:
    if "traction_rows" not in found:
        return [f"Saturation: the torques are scaled down together to {found['max_torque']:.6g} N m."]
    return [
        "Saturation: torques are scaled down, yaw torque first, so that no wheel slips or lifts and none has more than",
        f"{found['max_torque']:.6g} N m; where a wheel slips by more than {found['slipping']:g} m/s, together to",
        f"{found['slipping_torque']:.6g} N m, plus {found['grip']:.6g} N s times each wheel's slip speed.",
    ]


def _head(name: str, law: Controller, robot: Params, options: dict[str, Any], found: dict[str, Any]) -> list[str]:
    given = ", ".join(f"{option} = {value}" for option, value in options.items())
    return [
        f"The controller '{name}' for the robot {robot_name(robot)}; `ballbot export` of ballbot {__version__}.",
        str(CONTROLLERS[name]["summary"]),
        "",
        f"Options: {given or 'none, all at their defaults'}.",
        "",
        f"Use: call `ballbot_reset` once, `ballbot_step` every BALLBOT_CONTROL_DT = {law.control_dt:g} s, and hold the "
        "torques:",
        "",
        "    ballbot_controller controller;",
        "    ballbot_setpoint setpoint = {0};",
        "    ballbot_state state;         (from the sensors; `ballbot_roll` fills what only the wheels measure)",
        "    ballbot_real torques[3];",
        "    ballbot_reset(&controller);",
        "    ballbot_step(&controller, &state, &setpoint, torques);",
        "",
        "Units: m, rad, s, N m. Frames and the order of all numbers are at `ballbot_state` and `ballbot_setpoint`.",
        "Wheel i belongs to entry i of wheel_azimuths below; a positive torque drives it towards a positive speed.",
        f"Setpoint: it follows {', '.join(law.setpoint_parts)}; other parts are not read.",
        *_saturation(found),
        *(
            ["Control barrier: torques that would break speed_limit or boundary are changed."]
            if "barrier_tests" in found
            else []
        ),
        "`controller.last` has the torques of the last call and the fractions of the desired torques in them.",
        "Inputs are not checked: a NaN among them may give torques that are NaN, and may stay in an integral. Check",
        "them before the call, and call `ballbot_reset` after one that was wrong.",
        "Memory: all of it is in `ballbot_controller`; nothing is allocated. Precision: double, or what",
        "`#define BALLBOT_REAL float` before the #include chooses.",
        "",
        "Robot (SI units):",
        *(f"    {line}" for line in robot.to_toml().splitlines() if line),
    ]
