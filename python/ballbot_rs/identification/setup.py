"""What a fit and a replay begin with: a checked log, its robot, its windows and their simulator."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np

from ballbot_rs._checks import check_still_floor, real_array
from ballbot_rs._core import MODELS
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.motors import MAX_DELAY, MAX_LAG, Motors
from ballbot_rs.identification.parameters import Robot as FitRobot
from ballbot_rs.identification.plausibility import check_log
from ballbot_rs.identification.simulation import Simulator, check_torques
from ballbot_rs.identification.windows import Windows, split


def prepare(
    log: SensorLog | str | PathLike[str],
    robot: Robot | None,
    actuators: Mapping[str, Any] | str | None,
    model: str,
    sim_dt: float,
    window: float,
    imu_position: Sequence[float],
    num_threads: int | None,
    fields: Sequence[str] = (),
) -> tuple[SensorLog, FitRobot, Windows, Simulator]:
    """The log, its robot, its windows and their simulator; arguments as in `identify`.

    Raises:
        ValueError: a bad log or argument.
        OSError: a file cannot be read.
    """
    if not isinstance(log, SensorLog):
        log = SensorLog.read(log)
    base = FitRobot(params_of(robot), Motors.of(actuators))
    if any(base.params.floor_tilt):
        tilt = list(base.params.floor_tilt)
        raise InvalidInputError(f"robot.floor_tilt = {tilt}: a log has no heading, so the floor must be level")
    check_still_floor(base.params, "a log has no absolute position or time")
    if base.params.second_payload_mass > 0.0:
        mass = base.params.second_payload_mass
        raise InvalidInputError(f"robot.second_payload_mass = {mass} must be 0: only one payload can be fitted")
    if base.params.has_payload and any(base.params.payload_amplitude):
        amplitude = list(base.params.payload_amplitude)
        raise InvalidInputError(f"robot.payload_amplitude = {amplitude} must be 0: a log lacks its motion's start")
    offset = real_array("imu_position is", imu_position, "three finite numbers").astype(np.float64)
    if offset.shape != (3,) or not np.isfinite(offset).all():
        raise InvalidInputError(f"imu_position is {imu_position}, expected three finite numbers")
    if model not in MODELS or model == "planar":
        raise InvalidInputError(f"model = {model!r}: expected {', '.join(name for name in MODELS if name != 'planar')}")
    check_torques(log, base)
    check_log(log, base.params, sim_dt)
    # Commands before the log are unknown.
    settling = (MAX_DELAY if base.motors.delay or "delay" in fields else 0.0) + (
        MAX_LAG if base.motors.lag or "lag" in fields else 0.0
    )
    return log, base, split(log, window, sim_dt, settling), Simulator(log, model, sim_dt, offset, num_threads)
