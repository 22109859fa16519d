"""Poses of a log's robot and of its simulation: attitudes from body rates, positions from the rolling of the ball."""

import dataclasses

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs._quaternions import about_vertical, conjugate, product
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.starts import drive_matrix, quaternions_of
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Poses:
    """Poses in the rows of windows; NaN where a simulation fell."""

    #: Of the ball's center, inertial frame, m, shape (m, 2).
    position: Array
    #: Of body and ball, quaternions (w, x, y, z) to the inertial frame, shape (m, 4).
    attitude: Array
    ball_attitude: Array

    @property
    def tilt(self) -> Array:
        """Tilt about x and y, heading frame, rad, shape (m, 2)."""
        w, x, y, z = self.attitude.T
        # The vertical in the body frame.
        up = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=-1)
        sine = np.hypot(up[:, 0], up[:, 1])
        return np.asarray(
            np.stack([up[:, 1], -up[:, 0]], axis=-1) * (np.arctan2(sine, up[:, 2]) / np.maximum(sine, 1e-300))[:, None]
        )


def compared(
    log: SensorLog, params: Params, windows: Windows, tilts: Array, measured: Array, simulated: Array
) -> tuple[Poses, Poses]:
    """Poses of the measured and of the simulated motion, which begins each window in the measured pose.

    Logged attitudes and positions are the measured ones. Otherwise a window begins with a fitted tilt, where the window
    before ended; attitudes are integrals of body rates, positions follow from wheel angles if the ball does not slip.
    The heading of the frame of logged positions is the one that fits these positions best.

    Args:
        log: for its times, attitudes and positions.
        params: the robot.
        windows: of the log.
        tilts: at the beginning of each window, heading frame, rad, shape (w, 2).
        measured: wheel angles and body rates of each row, shape (m, 6 or 9).
        simulated: as measured.
    """
    time = log.time[windows.rows]
    own, other = (_rolled(time, windows, params, tilts, rows) for rows in (measured, simulated))
    first, sizes = windows.bounds[:-1], np.diff(windows.bounds)
    headings, places = _chained(time, windows, params, own, measured)
    attitude = None if log.attitude is None else log.attitude[windows.rows]
    if attitude is not None:
        headings = _heading(attitude)[first]
    if log.position is not None:
        position = log.position[windows.rows, :2]
        moved = position - np.repeat(position[first], sizes, axis=0)
        turned = _turned_flat(own.position, np.repeat(headings, sizes))
        offset = float(np.angle(np.sum((turned[:, 0] - 1j * turned[:, 1]) * (moved[:, 0] + 1j * moved[:, 1]))))
        headings, places = headings + offset, position[first]
        attitude = None if attitude is None else product(about_vertical(np.full(len(attitude), offset)), attitude)
    balls = _chained_balls(windows, own, headings)
    own, other = (
        _placed(one, *(np.repeat(of, sizes, axis=0) for of in (headings, places, balls))) for one in (own, other)
    )
    if log.position is not None:
        own = dataclasses.replace(own, position=position)
    return (own if attitude is None else dataclasses.replace(own, attitude=attitude)), other


def _rolled(time: Array, windows: Windows, params: Params, tilts: Array, rows: Array) -> Poses:
    """Poses relative to the beginning of each window, at heading 0."""
    found = Poses(np.zeros((len(rows), 2)), np.zeros((len(rows), 4)), np.zeros((len(rows), 4)))
    first, sizes = windows.bounds[:-1], np.diff(windows.bounds)
    found.attitude[first], found.ball_attitude[first] = quaternions_of(tilts), [1.0, 0.0, 0.0, 0.0]
    for place in range(1, int(sizes.max())):
        row = first[place < sizes] + place
        turn, ball_turn = _turns(time, params, rows, row)
        found.attitude[row] = product(found.attitude[row - 1], _rotation(turn))
        ball_turn = _rotated(_unit(found.attitude[row] + found.attitude[row - 1]), ball_turn)
        found.ball_attitude[row] = product(_rotation(ball_turn), found.ball_attitude[row - 1])
        found.position[row] = found.position[row - 1] + _path(params, ball_turn)
    return found


def _turns(time: Array, params: Params, rows: Array, row: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Rotation vectors of body and ball since the row before, body frame, rad, shape (n, 3)."""
    turn = 0.5 * (rows[row, 3:6] + rows[row - 1, 3:6]) * (time[row] - time[row - 1])[:, None]
    relative = (rows[row, :3] - rows[row - 1, :3]) * params.wheel_radius / params.ball_radius
    return turn, turn + np.linalg.solve(drive_matrix(params), relative.T).T


def _chained(time: Array, windows: Windows, params: Params, relative: Poses, measured: Array) -> tuple[Array, Array]:
    """Heading, rad, shape (w,), and position, m, shape (w, 2), at which each window begins."""
    row = windows.bounds[1:-1]
    turn, ball_turn = _turns(time, params, measured, row)
    moved = relative.position[row - 1] + _path(params, _rotated(relative.attitude[row - 1], ball_turn))
    turned = _heading(relative.attitude[row - 1]) + _rotated(relative.attitude[row - 1], turn)[:, 2]
    headings = np.concatenate([[0.0], np.cumsum(turned)])
    places = np.concatenate([np.zeros((1, 2)), np.cumsum(_turned_flat(moved, headings[:-1]), axis=0)])
    return headings, places


def _chained_balls(windows: Windows, relative: Poses, headings: Array) -> Array:
    """Attitude of the ball at which each window begins, shape (w, 4); its turn between two windows is left out."""
    turn = about_vertical(headings)
    ends = product(product(turn, relative.ball_attitude[windows.bounds[1:] - 1]), conjugate(turn))
    found = np.zeros_like(ends)
    found[0, 0] = 1.0
    for index in range(1, len(found)):
        found[index] = product(ends[index - 1], found[index - 1])
    return found


def _placed(poses: Poses, headings: Array, places: Array, balls: Array) -> Poses:
    turn = about_vertical(headings)
    ball = product(product(product(turn, poses.ball_attitude), conjugate(turn)), balls)
    return Poses(_turned_flat(poses.position, headings) + places, product(turn, poses.attitude), ball)


def _path(params: Params, ball_turn: Array) -> Array:
    return params.ball_radius * np.stack([ball_turn[:, 1], -ball_turn[:, 0]], axis=-1)


def _heading(attitude: Array) -> Array:
    """The rotation about the vertical that is left when the shortest rotation to the vertical is taken away."""
    return np.asarray(2.0 * np.arctan2(attitude[:, 3], attitude[:, 0]))


def _turned_flat(vectors: Array, angles: Array) -> Array:
    turned = (vectors[:, 0] + 1j * vectors[:, 1]) * np.exp(1j * angles)
    return np.stack([turned.real, turned.imag], axis=-1)


def _rotation(turn: Array) -> Array:
    """Quaternions of rotation vectors, shape (n, 4)."""
    angle = np.linalg.norm(turn, axis=1)
    return np.concatenate(
        [np.cos(0.5 * angle)[:, None], turn * (0.5 * np.sinc(angle / (2.0 * np.pi)))[:, None]], axis=1
    )


def _rotated(attitude: Array, vectors: Array) -> Array:
    w, axis = attitude[:, :1], attitude[:, 1:]
    return np.asarray(vectors + 2.0 * np.cross(axis, np.cross(axis, vectors) + w * vectors))


def _unit(quaternions: Array) -> Array:
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
