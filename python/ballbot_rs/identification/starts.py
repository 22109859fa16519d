"""Initial states of windows: coordinates of a rolling robot, and a first estimate of them from a log."""

from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Coordinates of a start at yaw 0, with their finite-difference steps. Ball position, ball attitude and heading have no
#: effect; the rates of the wheels follow from rolling.
COORDINATES: Final = {
    "tilt_x": 1e-5,
    "tilt_y": 1e-5,
    "rate_x": 1e-5,
    "rate_y": 1e-5,
    "rate_z": 1e-5,
    "velocity_x": 1e-5,
    "velocity_y": 1e-5,
    "spin": 1e-5,
}
#: Coordinates of a payload with their steps; its deflection along z has hardly an effect, since the ball carries it.
OF_PAYLOAD: Final = {
    "deflection_x": 1e-5,
    "deflection_y": 1e-5,
    "deflection_rate_x": 1e-4,
    "deflection_rate_y": 1e-4,
}
#: The tilt, and the deflection of a payload, in a start.
TILT: Final = slice(0, 2)
DEFLECTION: Final = slice(8, 10)
DEFLECTION_RATE: Final = slice(10, 12)
#: Rows from which rates at a start are estimated.
_ROWS: Final = 8


def steps_of(params: Params) -> Array:
    """Finite-difference steps of the coordinates of a start, shape (8,), of a robot with a payload (12,)."""
    return np.array([*COORDINATES.values(), *(OF_PAYLOAD.values() if params.has_payload else ())])


def quaternions_of(tilts: Array) -> Array:
    """Quaternions (w, x, y, z) of tilts at yaw 0, shape (w, 4), from their components, rad, shape (w, 2)."""
    angle = np.linalg.norm(tilts, axis=1)
    found = np.zeros((len(tilts), 4))
    found[:, 0] = np.cos(angle / 2.0)
    found[:, 1:3] = tilts * (0.5 * np.sinc(angle / (2.0 * np.pi)))[:, None]
    return found


def estimated(log: SensorLog, windows: Windows, params: Params) -> Array:
    """First estimate of the starts, shape (w, 8 or 12): upright, with the rates from gyroscope and encoders.

    A payload is at its place.

    Encoders and gyroscope give the ball's angular velocity without a model: psi' = k U (R^T w_k - Omega).
    """
    rows_of_wheels = drive_matrix(params)
    ratio = params.ball_radius / params.wheel_radius
    found = np.zeros((len(windows), len(steps_of(params))))
    for index in range(len(windows)):
        rows = windows.rows[windows.rows_of(index)][:_ROWS]
        times = log.time[rows] - log.time[rows[0]]
        rates = np.polyfit(times, log.gyro[rows], 1)[-1]
        wheel_speeds = np.polyfit(times, log.wheel_angles[rows], 2)[-2]
        ball = np.linalg.solve(rows_of_wheels, wheel_speeds) / ratio + rates
        velocity = (params.ball_radius * ball[1], -params.ball_radius * ball[0])
        found[index, : len(COORDINATES)] = [0.0, 0.0, *rates, *velocity, ball[2]]
    return found


def drive_matrix(params: Params) -> Array:
    """Vectors u of docs/conventions.md, body frame, a row for each wheel."""
    zeniths, azimuths = np.array(params.wheel_zeniths), np.array(params.wheel_azimuths)
    axles = np.stack(
        [-np.cos(zeniths) * np.cos(azimuths), -np.cos(zeniths) * np.sin(azimuths), np.sin(zeniths)], axis=-1
    )
    rims = np.stack([-np.sin(azimuths), np.cos(azimuths), np.zeros(3)], axis=-1)
    return np.asarray(axles - np.tan(params.roller_angle) * rims)
