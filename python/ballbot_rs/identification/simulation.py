"""What the sensors would have read in each window: all windows, and all changes of starts and parameters, as one batch."""

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._state_rows import body_axes_of
from ballbot_rs.identification.log import SensorLog
from ballbot_rs.identification.parameters import Robot
from ballbot_rs.identification.starts import quaternions_of
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Channels of a row: wheel angles, angular velocity, specific force.
SENSORS: Final = {"wheel_angle": slice(0, 3), "gyro": slice(3, 6), "acceleration": slice(6, 9)}

_BODY_QUATERNION: Final = slice(16, 20)
_KEPT: Final = slice(16, 29)


@dataclasses.dataclass(frozen=True)
class Column:
    """One simulation of all windows."""

    robot: Robot
    #: Of each window, as `starts.COORDINATES`, shape (w, 8).
    starts: Array


class Simulator:
    """Simulates windows of a log.

    Args:
        log: for its commands and times.
        windows: of the log.
        model: as in `Batch`.
        sim_dt: time step of the model, s.
        imu_position: of the accelerometer, body frame, m.
        num_threads: as in `Batch`.
    """

    def __init__(
        self, log: SensorLog, windows: Windows, model: str, sim_dt: float, imu_position: Array, num_threads: int | None
    ) -> None:
        self._log, self._windows = log, windows
        self._model, self._sim_dt, self._num_threads = model, sim_dt, num_threads
        self._imu_position = imu_position
        self._batches: dict[int, Batch] = {}
        self._settled: dict[int, list[Robot]] = {}
        # Rows between two model steps are interpolated; the last step may be beyond the window's last row.
        self._before = np.minimum(np.floor(windows.place).astype(np.int64), windows.steps - 1)
        self._share = windows.place - self._before

    @property
    def channels(self) -> int:
        """Numbers a row."""
        return 9 if self._log.accelerations is not None else 6

    def run(self, columns: Sequence[Column]) -> tuple[Array, npt.NDArray[np.bool_]]:
        """What the sensors read, shape (columns, m, channels), and which windows did not fall, shape (columns, w).

        The angle of each wheel counts from the start of its window. The specific force of a window's first row is zero.

        Raises:
            ValueError: the model refuses a robot or a start.
            KeyboardInterrupt: Ctrl-C.
        """
        windows, count = self._windows, len(self._windows)
        batch = self._batch(columns)
        torques = self._torques(columns)
        batch.reset(starts=self._starts(columns))
        upright = np.ones(len(columns) * count, dtype=np.bool_)
        kept = np.empty((windows.steps + 1, len(columns) * count, 13))
        kept[0] = batch.states()[:, _KEPT]
        for step in range(windows.steps):
            actions = torques[:, windows.starts + step] / batch.max_wheel_torque
            _, _, terminated, _ = batch.step(actions.reshape(-1, 3))
            upright &= ~terminated
            kept[step + 1] = batch.states()[:, _KEPT]
        found = np.stack([self._read(kept[:, i * count : (i + 1) * count], one) for i, one in enumerate(columns)])
        return found, upright.reshape(len(columns), count)

    def _batch(self, columns: Sequence[Column]) -> Batch:
        count = len(self._windows)
        if len(columns) not in self._batches:
            options = {
                "params": columns[0].robot.params,
                "model": self._model,
                "sim_dt": self._sim_dt,
                "control_dt": self._sim_dt,
                "max_wheel_torque": columns[0].robot.params.max_wheel_torque,
                "max_episode_steps": self._windows.steps + 1,
                # A fall is what the model has of it, not what a task counts as one.
                "fall_tilt": np.pi,
            }
            batch = Batch(len(columns) * count, num_threads=self._num_threads, **options)  # type: ignore[misc]
            self._batches[len(columns)] = batch
            self._settled[len(columns)] = [columns[0].robot] * len(columns)
        batch, settled = self._batches[len(columns)], self._settled[len(columns)]
        for index, column in enumerate(columns):
            if settled[index].params != column.robot.params:
                for window in range(count):
                    batch.set_params(index * count + window, column.robot.params)
                settled[index] = column.robot
        return batch

    def _torques(self, columns: Sequence[Column]) -> Array:
        """Of each column in each model step of the log, shape (columns, steps, 3)."""
        steps = int(self._windows.starts[-1]) + self._windows.steps
        found: dict[tuple[object, float], Array] = {}
        rows = []
        for column in columns:
            key = (column.robot.motors, column.robot.params.max_wheel_torque)
            if key not in found:
                found[key] = column.robot.motors.torques(self._log.time, self._log.torques, self._sim_dt, steps, key[1])
            rows.append(found[key])
        return np.stack(rows)

    def _starts(self, columns: Sequence[Column]) -> list[State]:
        states = []
        for column in columns:
            quaternions = quaternions_of(column.starts[:, :2])
            params = column.robot.params
            states += [
                State.rolling(params, start[5:7], quaternion, start[2:5], float(start[7]))
                for start, quaternion in zip(column.starts, quaternions, strict=True)
            ]
        return states

    def _read(self, kept: Array, column: Column) -> Array:
        """What the sensors read of one column, shape (m, channels), from parts of states, shape (steps + 1, w, 13)."""
        window, before, share = self._windows.window, self._before, self._share[:, None]
        rows = (1.0 - share) * kept[before, window] + share * kept[before + 1, window]
        read = np.empty((len(rows), self.channels))
        read[:, SENSORS["wheel_angle"]] = rows[:, 10:13] - kept[0, window, 10:13]
        read[:, SENSORS["gyro"]] = rows[:, 7:10] + column.robot.gyro_bias
        if self.channels == 9:
            read[:, SENSORS["acceleration"]] = self._specific_force(rows, column)
        return read

    def _specific_force(self, rows: Array, column: Column) -> Array:
        states = np.zeros((len(rows), 32))
        states[:, _BODY_QUATERNION] = rows[:, :4] / np.linalg.norm(rows[:, :4], axis=1, keepdims=True)
        axes = body_axes_of(states)
        velocity = rows[:, 4:7] + np.einsum("nij,nj->ni", axes, np.cross(rows[:, 7:10], self._imu_position))
        change = np.zeros_like(velocity)
        times = self._log.time[self._windows.rows]
        change[1:] = np.diff(velocity, axis=0) / np.diff(times)[:, None]
        change[:, 2] += column.robot.params.gravity
        force: Array = np.einsum("nji,nj->ni", axes, change) + column.robot.acc_bias
        # Its interval began before the window.
        force[self._windows.bounds[:-1]] = 0.0
        return force


def measured(log: SensorLog, windows: Windows) -> Array:
    """What the sensors of a log read, as `Simulator.run` has it, shape (m, channels)."""
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
            f"torque_{wheel + 1} of row {row} is {log.torques[row, wheel]:g} N·m, beyond max_wheel_torque = {limit:g} N·m"
        )
