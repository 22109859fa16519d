"""Simulated sensor readings of the windows: all windows and all finite differences as one batch."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Batch, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._state_rows import body_axes_of
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.motors import Motors
from ballbot_rs.identification.parameters import Robot
from ballbot_rs.identification.starts import DEFLECTION, DEFLECTION_RATE, TILT, quaternions_of
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Channels of a row: wheel angles, angular velocity, specific force.
SENSORS: Final = {"wheel_angle": slice(0, 3), "gyro": slice(3, 6), "acceleration": slice(6, 9)}

#: Steps whose whole states are in memory at once.
CHUNK: Final = 25

_BODY_QUATERNION: Final = slice(16, 20)
_KEPT: Final = slice(16, 29)


@dataclasses.dataclass(frozen=True)
class Column:
    """One simulation of all windows."""

    robot: Robot
    #: Of each window, as `starts.COORDINATES` and of a payload `starts.OF_PAYLOAD`, shape (w, 8 or 12).
    starts: Array


class Simulator:
    """Simulates windows of a log.

    Args:
        log: for its commands and times.
        model: as in `Batch`.
        sim_dt: time step of the model, s.
        imu_position: of the accelerometer, body frame, m.
        num_threads: as in `Batch`.
    """

    def __init__(self, log: SensorLog, model: str, sim_dt: float, imu_position: Array, num_threads: int | None) -> None:
        self._log, self._imu_position = log, imu_position
        self._model, self._sim_dt, self._num_threads = model, sim_dt, num_threads

    @property
    def channels(self) -> int:
        """Numbers per row."""
        return 9 if self._log.accelerations is not None else 6

    def check(self, robot: Robot) -> None:
        """A ValueError names a payload that is too stiff for the time steps."""
        if robot.params.has_payload:
            Ballbot(robot.params, self._model, self._sim_dt)

    def run(self, windows: Windows, columns: Sequence[Column]) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Sensor readings, shape (columns, m, channels), and which windows did not fall, shape (columns, w).

        Wheel angles count from the start of the window. The specific force in a window's first row is zero.

        Raises:
            ValueError: the model rejects a robot or a start.
            KeyboardInterrupt: Ctrl-C.
        """
        count = len(windows)
        batch = self._batch(count, windows.steps, columns)
        torques = self._torques(windows, columns)
        batch.reset(starts=_states(columns))
        if any(column.robot.params.has_payload for column in columns):
            batch.set_payloads(_payloads(columns))
        upright = np.ones(len(columns) * count, dtype=np.bool_)
        kept = np.empty((windows.steps + 1, len(columns) * count, 13))
        for first in range(0, windows.steps, CHUNK):
            steps = min(CHUNK, windows.steps - first)
            places = windows.starts + np.arange(first, first + steps)[:, None]
            actions = torques[:, places].transpose(1, 0, 2, 3).reshape(steps, -1, 3)
            rows = batch.rollout(steps=steps, actions=actions, record=("states", "terminated"))
            kept[first : first + steps + 1] = rows["states"][..., _KEPT]
            upright &= ~rows["terminated"].any(axis=0)
        return self._read(kept, windows, columns), upright.reshape(len(columns), count)

    def _batch(self, count: int, steps: int, columns: Sequence[Column]) -> Batch:
        first = columns[0].robot.params
        options: dict[str, Any] = {
            "robot": first,
            "model": self._model,
            "sim_dt": self._sim_dt,
            "control_dt": self._sim_dt,
            "max_wheel_torque": first.max_wheel_torque,
            "max_episode_steps": steps + 1,
            # A fall as the model defines it, not as a task does.
            "fall_tilt": np.pi,
        }
        batch = Batch(len(columns) * count, num_threads=self._num_threads, **options)
        for index, column in enumerate(columns):
            if column.robot.params != first:
                for window in range(count):
                    batch.set_params(index * count + window, column.robot.params)
        return batch

    def _torques(self, windows: Windows, columns: Sequence[Column]) -> Array:
        """Torques of each column in each model step of the log, relative to the limit, shape (columns, steps, 3)."""
        steps = int(windows.starts[-1]) + windows.steps
        limit = columns[0].robot.params.max_wheel_torque
        found: dict[Motors, Array] = {}
        for column in columns:
            motors = column.robot.motors
            if motors not in found:
                found[motors] = motors.torques(self._log.time, self._log.torques, self._sim_dt, steps, limit) / limit
        return np.stack([found[column.robot.motors] for column in columns])

    def _read(self, kept: Array, windows: Windows, columns: Sequence[Column]) -> Array:
        """The readings, shape (columns, m, channels), from parts of states, shape (steps + 1, columns · w, 13)."""
        # Rows between two model steps are interpolated; the last step may be beyond a window's last row.
        before = np.minimum(np.floor(windows.place).astype(np.int64), windows.steps - 1)
        share = (windows.place - before)[:, None]
        robots = len(windows) * np.arange(len(columns))[:, None] + windows.window
        rows = (1.0 - share) * kept[before, robots] + share * kept[before + 1, robots]
        read = np.empty((*rows.shape[:2], self.channels))
        read[..., SENSORS["wheel_angle"]] = rows[..., 10:13] - kept[0, robots, 10:13]
        read[..., SENSORS["gyro"]] = rows[..., 7:10] + _of_each(columns, "gyro_bias")
        if self.channels == 9:
            read[..., SENSORS["acceleration"]] = self._specific_force(rows, windows, columns)
        return read

    def _specific_force(self, rows: Array, windows: Windows, columns: Sequence[Column]) -> Array:
        states = np.zeros((*rows.shape[:2], 32))
        states[..., _BODY_QUATERNION] = rows[..., :4] / np.linalg.norm(rows[..., :4], axis=-1, keepdims=True)
        axes = body_axes_of(states)
        velocity = rows[..., 4:7] + (axes @ np.cross(rows[..., 7:10], self._imu_position)[..., None])[..., 0]
        change = np.zeros_like(velocity)
        change[:, 1:] = np.diff(velocity, axis=1) / np.diff(self._log.time[windows.rows])[:, None]
        change[..., 2] += np.array([column.robot.params.gravity for column in columns])[:, None]
        # As from an integrating IMU: in the attitude halfway through the interval.
        states[:, 1:, _BODY_QUATERNION] += states[:, :-1, _BODY_QUATERNION].copy()
        states[..., _BODY_QUATERNION] /= np.linalg.norm(states[..., _BODY_QUATERNION], axis=-1, keepdims=True)
        force: Array = (change[..., None, :] @ body_axes_of(states))[..., 0, :] + _of_each(columns, "acc_bias")
        # Its interval began before the window.
        force[:, windows.bounds[:-1]] = 0.0
        return force


def _states(columns: Sequence[Column]) -> list[State]:
    return [
        State.rolling(column.robot.params, start[5:7], quaternion, start[2:5], float(start[7]))
        for column in columns
        for start, quaternion in zip(column.starts, quaternions_of(column.starts[:, TILT]), strict=True)
    ]


def _payloads(columns: Sequence[Column]) -> Array:
    """Deflections of the payloads, as `Batch.payloads` has them."""
    found = np.zeros((len(columns), len(columns[0].starts), 2, 6))
    for rows, column in zip(found, columns, strict=True):
        # A payload of 0 kg is none.
        if column.robot.params.has_payload:
            rows[:, 0, :2] = column.starts[:, DEFLECTION]
            rows[:, 0, 3:5] = column.starts[:, DEFLECTION_RATE]
    return found.reshape(-1, 2, 6)


def _of_each(columns: Sequence[Column], name: str) -> Array:
    """A vector of each column's robot, shape (columns, 1, 3)."""
    return np.array([getattr(column.robot, name) for column in columns])[:, None]


def measured(log: SensorLog, windows: Windows) -> Array:
    """Sensor readings of a log, as from `Simulator.run`, shape (m, channels)."""
    parts = [log.wheel_angles[windows.rows], log.gyro[windows.rows]]
    if log.accelerations is not None:
        force = log.accelerations[windows.rows].copy()
        force[windows.bounds[:-1]] = 0.0
        parts.append(force)
    return np.concatenate(parts, axis=1)


def check_torques(log: SensorLog, robot: Robot) -> None:
    """A ValueError names a commanded torque that is beyond the motor's limit."""
    limit = robot.params.max_wheel_torque
    beyond = np.abs(log.torques)
    if beyond.max() > limit:
        row, wheel = np.unravel_index(beyond.argmax(), beyond.shape)
        raise InvalidInputError(
            f"torque_{wheel} of row {row} is {log.torques[row, wheel]:g} N·m, beyond max_wheel_torque = {limit:g} N·m"
        )
