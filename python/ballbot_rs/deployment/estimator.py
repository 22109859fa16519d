"""The estimator of a robot's state as a C99 header."""

from collections.abc import Mapping
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._core import Params, estimator_constants
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.deployment.c_text import comment, constants, guarded, piece
from ballbot_rs.deployment.robot import robot_name

#: Variance of a wheel rate, (rad/s)², below which single precision is insufficient: the covariance is then a small
#: difference of large numbers. 4096 ticks at 100 Hz give 3.9e-3.
LEAST_SINGLE: Final = 3e-3

REFUSAL: Final = """\
/* Encoders as fine as these, at this rate, need double precision: an array of -1 elements is an error. */
typedef char ballbot_estimator_of_these_sensors_needs_double[BALLBOT_IS_FLOAT ? -1 : 1];
"""


def estimator_header(
    robot: Robot | None,
    sensors: Mapping[str, Any] | str,
    control_dt: float = 0.01,
) -> str:
    """The text of a C99 header with the estimator of attitude, velocity, position and lean bias for one robot.

    Args:
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        sensors: as `sensors=` of an environment: the errors that the estimator expects.
        control_dt: time between two readings, s.

    Raises:
        ValueError: a number out of range.
    """
    robot = params_of(robot)
    values = estimator_constants(robot, sensors, control_dt)
    is_coarse = float(values["encoder_variance"]) >= LEAST_SINGLE
    parts = (
        piece("real"),
        "" if is_coarse else REFUSAL,
        piece("state"),
        "/* ---- Constants, SI units; variances. */\n\n" + constants(values, "BALLBOT_ESTIMATOR"),
        *map(piece, ("rotation", "estimator", "estimator_prediction", "estimator_correction", "estimator_update")),
    )
    return guarded(
        "estimator", "estimator", comment(_head(robot, sensors, control_dt)), "\n".join(part for part in parts if part)
    )


def _head(robot: Params, sensors: Any, control_dt: float) -> list[str]:
    return [
        f"The estimator of the robot {robot_name(robot)}; `ballbot export` of ballbot {__version__}.",
        "An error-state Kalman filter of IMU and wheel encoders; docs/estimator.md of ballbot has its equations.",
        "",
        *_sensors(sensors),
        "",
        f"Use: call `ballbot_estimator_begin` once, the rest every BALLBOT_ESTIMATOR_DT = {control_dt:g} s:",
        "",
        "    ballbot_estimator estimator;",
        "    ballbot_state state = {{1, 0, 0, 0}, {0}, {0}, {0}, {0}, {0}};    (upright, at rest)",
        "    ballbot_estimator_begin(&estimator, &state);",
        "    ballbot_estimator_update(&estimator, gyro, specific_force, wheel_rates, &state);",
        "    ballbot_estimator_balance(&estimator, &state);    (if the equilibrium is to be found, too)",
        "",
        "Units: m, rad, s. Wheel i belongs to entry i of wheel_azimuths below.",
        "Memory: all of it is in `ballbot_estimator`; nothing is allocated. Precision: double, or what",
        "`#define BALLBOT_REAL float` before the #include chooses, which fine encoders do not allow.",
        "",
        "Robot (SI units):",
        *(f"    {line}" for line in robot.to_toml().splitlines() if line),
    ]


def _sensors(sensors: Mapping[str, Any] | str) -> list[str]:
    if isinstance(sensors, str):
        return [f"Sensors: '{sensors}'."]
    return ["Sensors (SI units; others are exact):", *(f"    {name} = {value}" for name, value in sensors.items())]
