"""A log of a robot: torques, wheel encoders and IMU over time, in memory and in files."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _files
from ballbot_rs._checks import did_you_mean, real_array
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._reading import open_regular, read_regular
from ballbot_rs.identification.logs.column_map import OPTIONAL, ColumnMap
from ballbot_rs.identification.logs.mcap_log import read_mcap
from ballbot_rs.identification.logs.merge import LogReport, merged
from ballbot_rs.identification.logs.recording import from_table, single_precision
from ballbot_rs.identification.logs.tables import MAX_LOG_FILE, Column, csv_columns, npz_columns

Array = npt.NDArray[np.float64]

#: Columns of a file by field of `SensorLog`.
COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "time": ("time",),
    "torques": ("torque_0", "torque_1", "torque_2"),
    "wheel_angles": ("wheel_angle_0", "wheel_angle_1", "wheel_angle_2"),
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "accelerations": ("acc_x", "acc_y", "acc_z"),
    "attitude": ("attitude_w", "attitude_x", "attitude_y", "attitude_z"),
    "position": ("position_x", "position_y", "position_z"),
}
#: Units of the noise of each sensor.
UNITS: Final[Mapping[str, str]] = {"wheel_angle": "rad", "gyro": "rad/s", "acceleration": "m/s²"}
#: Files that are read.
SUFFIXES: Final = (".csv", ".npz", ".mcap")

#: Longest median time between two rows, s.
MAX_STEP: Final = 0.05
#: Largest rate of a gyroscope, rad/s: 2000 deg/s, the usual range of MEMS gyroscopes.
MAX_RATE: Final = 35.0
#: Largest change of a wheel angle between two rows, rad. Half a turn is the wrap of an encoder.
MAX_TURN: Final = np.pi
#: Largest deviation of an attitude's norm from 1.
MAX_NORM_ERROR: Final = 0.01
#: Range of the mean magnitude of the specific force, m/s², of a robot that stays upright.
SPECIFIC_FORCE: Final = (5.0, 20.0)


@dataclasses.dataclass(frozen=True)
class SensorLog:
    """Torques and measurements of one robot, one row per sample.

    ```python
    bb.record_log(seconds=2.0).write("log.csv")
    log = bb.SensorLog.read("log.csv")
    print(log.time[-1], log.gyro.shape)
    ```

    `torques[k]` acts from `time[k]` to `time[k + 1]`; everything else is measured at `time[k]`. Time steps may differ,
    and rows may be missing.

    Args:
        time: s, increasing, shape (n,).
        torques: of wheels 0 to 2 as commanded, N·m, shape (n, 3).
        wheel_angles: of wheels 0 to 2 relative to the body, not wrapped, rad, shape (n, 3).
        gyro: angular velocity of the body, body frame, rad/s, shape (n, 3).
        accelerations: specific force at the IMU, body frame, m/s², shape (n, 3): the change of velocity since the
            previous row, divided by the time between them, minus gravity. At rest upright it is (0, 0, 9.81). None:
            not measured.
        attitude: of the body, quaternion (w, x, y, z) from the body frame to an inertial frame with z up, shape (n, 4);
            normalized. None: not measured.
        position: of the ball's center in an inertial frame with z up, m, shape (n, 3). None: not measured. Only
            `replay` uses attitude and position; the headings of their frames may differ.
        report: how `read` brought quantities with different time stamps to common rows; None for other logs.

    Raises:
        ValueError: a wrong shape, a number that is not finite, a time that does not increase, or a magnitude that no
            robot reaches in these units; the message has the column, the row (from 0), the value and the limit.
    """

    time: Array
    torques: Array
    wheel_angles: Array
    gyro: Array
    accelerations: Array | None = None
    attitude: Array | None = None
    position: Array | None = None
    report: LogReport | None = dataclasses.field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name, columns in COLUMNS.items():
            value = getattr(self, name)
            if value is None and name in OPTIONAL:
                continue
            array = real_array(f"{name} is", value, "numbers").astype(np.float64)
            shape = (len(array) if array.ndim else 0, len(columns))[: 1 if name == "time" else 2]
            if array.shape != shape or (name != "time" and len(array) != len(self.time)):
                rows = "n" if name == "time" else str(len(self.time))
                expected = f"({rows},)" if name == "time" else f"({rows}, {len(columns)})"
                raise InvalidInputError(f"{name} has the shape {array.shape}, expected {expected}")
            _check_finite(name, array)
            if name == "attitude":
                array = _normalized(array)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        _check_time(self.time)
        _check_units(self)

    @property
    def step(self) -> float:
        """Median time between two rows, s."""
        return float(np.median(np.diff(self.time)))

    @classmethod
    def read(
        cls, path: str | PathLike[str], columns: str | PathLike[str] | Mapping[str, Any] | None = None
    ) -> SensorLog:
        """A log from a CSV file with a header, an npz file with one array per column, or an MCAP file.

        In an MCAP file: ROS 2 messages `sensor_msgs/msg/Imu` and `sensor_msgs/msg/JointState` in CDR, with torques as
        `effort`, or what `Trajectory.to_mcap` wrote. In other files: the columns `time` (s), `torque_0` to `torque_2`
        (N·m), `wheel_angle_0` to `wheel_angle_2` (rad), `gyro_x`, `gyro_y`, `gyro_z` (rad/s), and optionally `acc_x`,
        `acc_y`, `acc_z` (m/s²), `attitude_w` to `attitude_z` and `position_x` to `position_z` (m). A map names other
        columns, units, signs and time stamps; docs/identify.md has its keys, and how different rates, gaps and clocks
        are brought to common rows. `report` has the result.

        Args:
            path: the log.
            columns: a TOML file with a column map, or the map: its tables by key.

        Raises:
            ValueError: a column is missing, a cell is not a number, or as the constructor; the message has the file.
            OSError: a file cannot be read.
            ModuleNotFoundError: an MCAP file or a clock offset to estimate, and a library is missing (extras `mcap` and
                `identify`).
        """
        path = Path(path)
        if path.suffix not in SUFFIXES:
            raise InvalidInputError(f"{path}: the name of a log must end in .csv, .npz or .mcap")
        if columns is None:
            found = None
        else:
            found = ColumnMap.of(columns) if isinstance(columns, Mapping) else ColumnMap.load(columns)
        try:
            if path.suffix == ".mcap":
                series, found = read_mcap(read_regular(path, MAX_LOG_FILE), found)
                fields, report = merged(series, found)
            elif found is None:
                fields, report = _fields(_table(path, {title for titles in COLUMNS.values() for title in titles})), None
            else:
                fields, report = merged(from_table(_table(path, found.names, blanks=True), found), found)
            return cls(**fields, report=report)
        except (ValueError, csv.Error) as error:
            raise InvalidInputError(f"{path}: {error}") from error

    def write(self, path: str | PathLike[str]) -> None:
        """Writes the log; `read` restores it bit for bit.

        Raises:
            ValueError: the name ends in neither .csv nor .npz.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        path = Path(path)
        columns: dict[str, Array] = {}
        for name, titles in COLUMNS.items():
            values = getattr(self, name)
            if values is not None:
                columns.update(zip(titles, np.atleast_2d(values.T), strict=True))
        if path.suffix == ".npz":
            packed = io.BytesIO()
            np.savez_compressed(packed, **columns)  # type: ignore[arg-type]
            _files.write(path, packed.getvalue())
        elif path.suffix == ".csv":
            rows = zip(*(values.tolist() for values in columns.values()), strict=True)
            lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
            _files.write(path, "\n".join(lines) + "\n")
        else:
            raise InvalidInputError(f"{path}: the name of a log must end in .csv or .npz")


def _table(path: Path, known: Collection[str], blanks: bool = False) -> Mapping[str, Column]:
    if path.suffix == ".npz":
        return npz_columns(read_regular(path, MAX_LOG_FILE), known)
    with open_regular(path, MAX_LOG_FILE) as file:
        return csv_columns(file, known, blanks)


def _fields(columns: Mapping[str, Array]) -> dict[str, Array]:
    fields = {}
    for name, titles in COLUMNS.items():
        missing = [title for title in titles if title not in columns]
        if name in OPTIONAL and len(missing) == len(titles):
            continue
        if missing:
            hint = f"{did_you_mean(missing[0], columns)}; columns= names columns with other titles, docs/identify.md"
            raise InvalidInputError(f"column {', '.join(missing)} is missing; there are {', '.join(columns)}{hint}")
        values = [columns[title] for title in titles]
        for title, column in zip(titles, values, strict=True):
            if len(column) != len(columns["time"]):
                raise InvalidInputError(f"{title} has {len(column)} rows, time has {len(columns['time'])}")
        fields[name] = values[0] if name == "time" else np.stack(values, axis=-1)
    return fields


def _check_finite(name: str, array: Array) -> None:
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0][0], bad[0][1] if array.ndim > 1 else 0
        rows = len(np.unique(bad[:, 0]))
        raise InvalidInputError(
            f"{COLUMNS[name][column]} of row {row} is {array[tuple(bad[0])]}; {rows} of {len(array)} rows are not "
            f"finite: leave "
            "them out, gaps in time are allowed"
        )


def _normalized(attitude: Array) -> Array:
    norms = np.linalg.norm(attitude, axis=1)
    row = int(np.argmax(np.abs(norms - 1.0)))
    if not abs(norms[row] - 1.0) <= MAX_NORM_ERROR:
        raise InvalidInputError(
            f"{', '.join(COLUMNS['attitude'])} of row {row} have the norm {norms[row]:g}, expected 1 ± {MAX_NORM_ERROR}"
        )
    return np.asarray(attitude / norms[:, None])


def _check_time(time: Array) -> None:
    if len(time) < 2:
        raise InvalidInputError(f"the log has {len(time)} rows, at least 2 are needed")
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise InvalidInputError(
            f"time of row {row} is {time[row]:g} s, after {time[row - 1]:g} s: it must increase{single_precision(time)}"
        )
    median = float(np.median(steps))
    if median > MAX_STEP:
        raise InvalidInputError(
            f"the median time step is {median:g} s, the limit is {MAX_STEP} s: sample faster, and give time in "
            'seconds, or its unit: time = "ms" in the table [units] of a column map (columns=)'
        )


def _check_units(log: SensorLog) -> None:
    rates = np.abs(log.gyro)
    if rates.max() > MAX_RATE:
        row, column = np.unravel_index(rates.argmax(), rates.shape)
        raise InvalidInputError(
            f"{COLUMNS['gyro'][column]} of row {row} is {log.gyro[row, column]:g} rad/s, the limit is ±{MAX_RATE:g} "
            f"rad/s: {_hint(log, 'gyro', 'give rates in rad/s, not deg/s')}"
        )
    turns = np.abs(np.diff(log.wheel_angles, axis=0))
    # Wheels may turn far during a gap.
    turns[np.diff(log.time) > 1.5 * log.step] = 0.0
    if turns.max() > MAX_TURN:
        row, column = np.unravel_index(turns.argmax(), turns.shape)
        raise InvalidInputError(
            f"{COLUMNS['wheel_angles'][column]} changes by {turns[row, column]:g} rad to row {row + 1}, the limit is "
            f"{MAX_TURN:.4g} rad: unwrap the encoders, and "
            f"{_hint(log, 'wheel_angles', 'give angles in rad, not deg or ticks')}"
        )
    if log.accelerations is not None:
        mean = float(np.linalg.norm(log.accelerations, axis=1).mean())
        low, high = SPECIFIC_FORCE
        if not low <= mean <= high:
            looks = "; it looks like g" if 0.8 < mean < 1.2 else ""
            raise InvalidInputError(
                f"the mean magnitude of acc_x, acc_y, acc_z is {mean:g} m/s², expected {low:g} to {high:g} m/s²{looks}"
                f": {_hint(log, 'accelerations', 'give the specific force, gravity included, in m/s²')}"
            )


def _hint(log: SensorLog, name: str, without: str) -> str:
    """What to change: in the column map if there is one."""
    if log.report is None:
        return f"{without}, or name their unit in the table [units] of a column map (columns=)"
    return f'[units] {name} of the column map is "{log.report.columns.units[name]}"; {without}'
