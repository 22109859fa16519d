"""The supervisor of a robot's limits as a C99 header."""

import math
from collections.abc import Mapping
from os import PathLike
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import __version__
from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Controller, LinearModel, Params, load_actuators
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.deployment.c_text import comment, constants, guarded, piece
from ballbot_rs.deployment.robot import robot_name

Array = npt.NDArray[np.float64]

#: Speed of a wheel that nothing limits, rad/s.
NO_LIMIT: Final = 1e30

#: Speed of a wheel that the ball drives over the largest speed of its motor: a choice.
BACK_DRIVEN: Final = 1.2

#: Control steps without usable readings that are bridged.
MOST_MISSED: Final = 3

_DIRECTIONS: Final = 72


@named
def supervisor_header(
    robot: Robot | None = None,
    control_dt: float = 0.01,
    *,
    actuators: Mapping[str, Any] | str | PathLike[str] | None = None,
    max_torque: float | None = None,
    max_speed: float | None = None,
    continuous_torque: float | None = None,
    heating_time: float = 10.0,
    ramp_time: float | None = None,
    most_missed: int = MOST_MISSED,
    basin: float = 1.0,
    tilt_time: float | None = None,
) -> str:
    """The text of a C99 header with the supervisor of one robot; docs/safety.md describes it.

    Args:
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        control_dt: time between two calls, s.
        actuators: as `actuators=` of an environment: motors, from which the largest speed of a wheel follows.
        max_torque: largest torque of a motor, N·m; None is `max_wheel_torque` of the robot.
        max_speed: speed of a wheel above which it trips, rad/s; None is 1.2 times `speed_limit` of the actuators, else
            1.2 times their `no_load_speed`, else no limit.
        continuous_torque: torque that a motor can sustain indefinitely, N·m; None is a third of `max_torque`.
        heating_time: time constant of the heat of a motor, s.
        ramp_time: time from a trip to zero torque, s; None is the robot's time constant of toppling.
        most_missed: control steps in a row without usable readings that are bridged; one more trips.
        basin: fraction of the recoverable tilts and tilt rates within which it does not trip.
        tilt_time: time beyond them after which it trips, s; None is half of the robot's time constant of toppling.

    Raises:
        ValueError: a number out of range, or unknown actuators.
    """
    robot = params_of(robot)
    torque = robot.max_wheel_torque if max_torque is None else check_bounded("max_torque", max_torque, 1e-9, 1e9)
    rest = torque / 3.0 if continuous_torque is None else continuous_torque
    tilt, rate, toppling = recoverable(robot, torque)
    dt = check_bounded("control_dt", control_dt, 1e-6, 1.0)
    fraction = check_bounded("basin", basin, 0.01, 1.0)
    if isinstance(most_missed, bool) or not isinstance(most_missed, int) or not 0 <= most_missed <= 10_000:
        raise InvalidInputError(f"most_missed = {most_missed!r}: expected a whole number from 0 to 10000")
    values: dict[str, Any] = {
        "dt": dt,
        "mast": np.array(robot.body_com) / np.linalg.norm(robot.body_com),
        "max_tilt": fraction * tilt,
        "max_tilt_rate": fraction * rate,
        "max_torque": torque,
        "max_speed": _speed(max_speed, actuators),
        "continuous_torque": check_bounded("continuous_torque", rest, 1e-9, 1e9),
        # Heat is a first-order lag, in steps of the controller.
        "heating_time": check_bounded("heating_time", heating_time, dt, 1e9),
        "ramp_time": check_bounded("ramp_time", 1.0 / toppling if ramp_time is None else ramp_time, dt, 1e9),
    }
    lasting = check_bounded("tilt_time", 0.5 / toppling if tilt_time is None else tilt_time, 0.0, 10.0)
    patience = max(1, round(lasting / dt))
    body = (
        piece("real"),
        piece("state"),
        "/* ---- Constants, SI units. */\n\n"
        + constants(values, "BALLBOT_SUPERVISOR")
        + f"#define BALLBOT_SUPERVISOR_TILT_STEPS {patience}\n"
        + f"#define BALLBOT_SUPERVISOR_MOST_MISSED {most_missed}\n",
        piece("supervisor"),
    )
    return guarded(
        "supervisor", "supervisor", comment(_head(robot, values, fraction, patience, most_missed)), "\n".join(body)
    )


def recoverable(robot: Params, max_torque: float) -> tuple[float, float, float]:
    """The basin of a robot on a level floor in its worst direction, and how fast it topples.

    The largest torque that tilts the body back grows linearly with the tilt, as the wheels on the side to which it
    leans are loaded: docs/safety.md has the closed form that follows.

    Returns:
        The largest tilt from equilibrium that a robot at rest recovers from, rad; the largest tilt rate that an
        upright robot recovers from, rad/s; the rate at which it topples, 1/s.
    """
    level = robot.replace(floor_tilt=(0.0, 0.0))
    linear = LinearModel(level)
    squared, turning = linear.toppling_squared, linear.turning_torques
    toppling = math.sqrt(squared)
    # Of a law with traction scaling: at rest, per tilt, per torque; each is at most 0.
    rows: Array = np.asarray(Controller("pid", level, traction=True).constants()["traction_rows"])
    tilt, rate = math.inf, math.inf
    for angle in np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False).tolist():
        axis = np.array([-math.sin(angle), math.cos(angle)])
        torques = turning @ (-squared * np.append(axis, 0.0))
        per_torque, per_tilt = rows[:, 3:6] @ torques, rows[:, 1:3] @ axis
        limits = [(max_torque / float(np.abs(torques).max()), 0.0)]
        for start, lean, growth in zip(rows[:, 0].tolist(), per_tilt.tolist(), per_torque.tolist(), strict=True):
            if growth > 0.0:
                limits.append((-start / growth, -lean / growth))
        for upright, slope in limits:
            if slope < 1.0:
                tilt = min(tilt, upright / (1.0 - slope))
                rate = min(rate, toppling * upright / math.sqrt(1.0 - slope))
    return tilt, rate, toppling


def _speed(given: float | None, actuators: Mapping[str, Any] | str | PathLike[str] | None) -> float:
    of_motors = NO_LIMIT if actuators is None else _speed_of(actuators)
    return of_motors if given is None else check_bounded("max_speed", given, 1e-9, NO_LIMIT)


def _speed_of(actuators: Mapping[str, Any] | str | PathLike[str]) -> float:
    motors: Mapping[str, Any] = actuators if isinstance(actuators, Mapping) else load_actuators(actuators)
    known = load_actuators("ideal")
    if unknown := [name for name in motors if name not in known]:
        raise InvalidInputError(f"actuators has an unknown option {unknown[0]!r}: expected {', '.join(known)}")
    speeds = [
        check_bounded(f"actuators.{name}", motors.get(name, 0.0), 0.0, NO_LIMIT)
        for name in ("speed_limit", "no_load_speed")
    ]
    own = next(filter(None, speeds), 0.0)
    return BACK_DRIVEN * own if own > 0.0 else NO_LIMIT


def _head(robot: Params, values: Mapping[str, Any], fraction: float, patience: int, most_missed: int) -> list[str]:
    dt, limit = f"{values['dt']:g}", {name: f"{np.max(value):.6g}" for name, value in values.items()}
    speed = f"{limit['max_speed']} rad/s (given, or 1.2 times the motors')"
    return [
        f"The supervisor of the robot {robot_name(robot)}; `ballbot export` of ballbot {__version__}.",
        "docs/safety.md of ballbot has where the limits are from.",
        "",
        f"Use: call `ballbot_supervisor_reset` once, `ballbot_supervise` every BALLBOT_SUPERVISOR_DT = {dt} s after",
        "the controller:",
        "",
        "    ballbot_supervisor supervisor = {0};",
        "    ballbot_supervisor_reset(&supervisor);",
        "    ballbot_step(&controller, &state, &setpoint, torques);",
        "    status = ballbot_supervise(&supervisor, &state, fresh, torques);",
        "",
        "Beyond these it trips: the torques fall linearly to zero and stay there until a reset.",
        f"    tilt: {limit['max_tilt']} rad at rest, {limit['max_tilt_rate']} rad/s upright, and sums of fractions,",
        f"        for {patience} steps in a row; {fraction:g} of what traction, torques and toppling allow",
        f"    speed of a wheel: {'none' if values['max_speed'] == NO_LIMIT else speed}",
        f"    steps in a row without readings, or with numbers that are not finite: {most_missed}; up to these",
        "        the last torques hold",
        "These only reduce the torques, all together:",
        f"    torque of a motor: {limit['max_torque']} N m (given, or of the robot)",
        f"    heat of a motor: of {limit['continuous_torque']} N m forever (given, or a third of the largest torque),",
        f"        with the time constant {limit['heating_time']} s (given, or 10 s)",
        f"Ramp: {limit['ramp_time']} s (given, or the time constant of toppling).",
        "",
        "Units: m, rad, s, N m. Memory: all of it is in `ballbot_supervisor`; nothing is allocated. Precision: double,",
        "or what `#define BALLBOT_REAL float` before the #include chooses. Not with -ffast-math, which has no NaN.",
        "",
        "Robot (SI units):",
        *(f"    {line}" for line in robot.to_toml().splitlines() if line),
    ]
