"""Residuals of a replay: measured minus simulated values, by column and by window."""

import dataclasses
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs.identification.logs.log import COLUMNS, UNITS, SensorLog
from ballbot_rs.identification.poses import Poses
from ballbot_rs.identification.simulation import SENSORS
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Columns of the sensors, in the order of `simulation.SENSORS`.
TITLES: Final = (*COLUMNS["wheel_angles"], *COLUMNS["gyro"], *COLUMNS["accelerations"])


@dataclasses.dataclass(frozen=True)
class Residual:
    """Measured minus simulated values of one column, over all windows that did not fall."""

    column: str
    unit: str
    #: Root mean square of the measured values minus their mean in each window.
    measured: float
    #: Root mean square of the residuals.
    rms: float
    #: Standard deviation of the noise, from third differences of the measurements.
    noise: float

    @property
    def explained(self) -> float:
        """Fraction of the measured changes' mean square that the simulation explains; negative if worse than none."""
        return 1.0 - (self.rms / self.measured) ** 2 if self.measured > 0.0 else 0.0


def of_sensors(rows: Array, differences: Array, windows: Windows, log: SensorLog) -> tuple[Residual, ...]:
    """Residuals of the columns of wheel angles, body rates and specific forces."""
    own, rest = _changes(rows, differences, windows)
    found = []
    for name, values in _series(log):
        noise = _noise(values)
        for axis, index in enumerate(range(SENSORS[name].start, SENSORS[name].stop)):
            found.append(Residual(TITLES[index], UNITS[name], own[index], rest[index], noise[axis]))
    return tuple(found)


def of_poses(poses: tuple[Poses, Poses], windows: Windows, log: SensorLog) -> list[Residual]:
    """Residuals of what a log has of the pose: tilt, and position since the start of each window."""
    measured, simulated = poses
    logged: list[tuple[str, str, Array, Array]] = []
    if log.attitude is not None:
        logged.append(("tilt", "rad", measured.tilt, simulated.tilt))
    if log.position is not None:
        logged.append(("position", "m", measured.position, simulated.position))
    found = []
    for name, unit, own_pose, other in logged:
        own, rest = _changes(own_pose, own_pose - other, windows)
        noise = _noise(own_pose)
        found += [Residual(f"{name}_{axis}", unit, own[i], rest[i], noise[i]) for i, axis in enumerate("xy")]
    return found


def _changes(rows: Array, differences: Array, windows: Windows) -> tuple[list[float], list[float]]:
    """Root mean squares of each column's changes within windows, and of its residuals."""
    usable = np.isfinite(differences)
    counts = np.maximum(np.add.reduceat(usable, windows.bounds[:-1], axis=0, dtype=np.int64), 1)
    means = np.add.reduceat(np.where(usable, rows, 0.0), windows.bounds[:-1], axis=0) / counts
    changes = np.where(usable, rows - means[windows.window], np.nan)
    own, rest = (np.sqrt(np.nanmean(one**2, axis=0)).tolist() for one in (changes, differences))
    return own, rest


def _noise(values: Array) -> list[float]:
    """Standard deviations of white noise, from third differences."""
    found: list[float] = np.sqrt((np.diff(values, n=3, axis=0) ** 2).mean(axis=0) / 20.0).tolist()
    return found


def _series(log: SensorLog) -> list[tuple[str, Array]]:
    series = (("wheel_angle", log.wheel_angles), ("gyro", log.gyro), ("acceleration", log.accelerations))
    return [(name, values) for name, values in series if values is not None]


def by_window(differences: Array, windows: Windows, spreads: Mapping[str, float]) -> dict[str, Array]:
    """Root mean square residual of each sensor in each window, in standard deviations of its noise, shape (w,)."""
    found = {}
    for name, spread in spreads.items():
        own = differences[:, SENSORS[name]]
        usable = np.isfinite(own)
        sums = np.add.reduceat(np.where(usable, own, 0.0) ** 2, windows.bounds[:-1], axis=0).sum(axis=1)
        counts = np.add.reduceat(usable, windows.bounds[:-1], axis=0, dtype=np.int64).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            found[name] = np.sqrt(sums / counts) / spread
    return found
