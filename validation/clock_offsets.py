"""Errors of the estimated clock offset and drift between IMU and encoders, in random logs of the presets.

`python -m validation.clock_offsets` prints the tables of docs/identify.md.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS
from ballbot_rs.identification.logs.clocks import DRIFTS, estimated
from ballbot_rs.identification.logs.recording import Series
from validation.page import table

#: Largest offset, s, and drift, s/s, that are drawn.
OFFSET = 0.1
DRIFT = 100e-6
#: Shortest and longest log, s.
SECONDS = (10.0, 60.0)
SIM_DT = 0.0005

Array = npt.NDArray[np.float64]


@dataclasses.dataclass
class Errors:
    """Errors of the offsets, s, and of the drifts, s/s, with their stated standard errors; a log each."""

    offsets: Array
    offset_errors: Array
    drifts: Array
    drift_errors: Array

    @property
    def relative(self) -> Array:
        """Of the offsets, in standard errors."""
        return self.offsets / self.offset_errors

    @property
    def relative_drifts(self) -> Array:
        """Of the drifts, in standard errors, of logs that are long enough."""
        known = np.isfinite(self.drift_errors)
        return self.drifts[known] / self.drift_errors[known]


def errors(robot: str, control_dt: float, logs: int, seed: int = 0) -> Errors:
    """Errors in logs of random length, excitation and offset; long logs have a random drift, too."""
    rng = np.random.default_rng([seed, round(1e6 * control_dt), *robot.encode()])
    found = []
    for index in range(logs):
        seconds = rng.uniform(*SECONDS)
        offset, drift = rng.uniform(-OFFSET, OFFSET), rng.uniform(-DRIFT, DRIFT) if seconds > 1.1 * DRIFTS else 0.0
        log = bb.record_log(robot, seconds, sim_dt=SIM_DT, control_dt=control_dt, seed=1000 * seed + index)
        imu = Series("gyro", "imu", log.time + offset + drift * log.time, log.gyro)
        one = estimated(imu, Series("wheel_angles", "encoders", log.time, log.wheel_angles))
        if one is None:
            raise RuntimeError(f"the log {index} of {robot} determines no offset")
        # Rates of the model are half a step older than its angles.
        error = one.value - offset - drift * one.time - 0.5 * SIM_DT
        found.append((error, one.error, one.drift - drift, one.drift_error))
    return Errors(*np.transpose(found))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def markdown(logs: int = 24) -> str:
    """The table, and below it the errors of all logs together."""
    rows, every = [], []
    for robot in ROBOTS:
        for control_dt in (0.005, 0.01):
            one = errors(robot, control_dt, logs)
            every.append(one)
            worst = f"{1e3 * np.abs(one.offsets).max():.2f} ms"
            relative, drifts = one.relative, one.relative_drifts
            in_errors = [f"{_rms(z):.2f}, {np.abs(z).max():.1f}" for z in (relative, drifts)]
            offsets = f"{1e3 * _rms(one.offsets):.2f} ms, {worst}"
            rows.append([robot, f"{1e3 * control_dt:g} ms", offsets, *in_errors])
    titles = ["robot", "rows", "offset: rms, largest error", "in standard errors", "drift, in standard errors"]
    both = [np.concatenate([getattr(one, name) for one in every]) for name in ("relative", "relative_drifts")]
    last = "; ".join(
        f"{what} {_rms(z):.2f} rms, {np.abs(z).max():.1f} at most, in {len(z)} logs"
        for what, z in zip(("offset", "drift"), both, strict=True)
    )
    return f"{table(titles, rows)}\n\nIn standard errors: {last}."


if __name__ == "__main__":
    print(markdown())
