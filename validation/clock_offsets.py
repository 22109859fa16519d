"""Errors of the estimated clock offset and drift between IMU and encoders, for logs of the presets.

`python -m validation.clock_offsets` prints the table of docs/identify.md.
"""

from collections.abc import Sequence

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS
from ballbot_rs.identification.clocks import estimated
from ballbot_rs.identification.recording import Series
from validation.page import table

#: s.
OFFSET = 0.0123
SIM_DT = 0.0005
#: s, and s/s.
LONG = 60.0
DRIFT = 100e-6


def errors(robot: str, control_dt: float, logs: int = 8, seconds: float = 10.0, drift: float = 0.0) -> list[float]:
    """Largest errors of the offsets of logs, s, and of the drifts, s/s, each also in standard errors."""
    found = []
    for seed in range(logs):
        log = bb.record_log(robot, seconds, sim_dt=SIM_DT, control_dt=control_dt, seed=seed)
        imu = Series("gyro", "imu", log.time + OFFSET + drift * log.time, log.gyro)
        offset = estimated(imu, Series("wheel_angles", "encoders", log.time, log.wheel_angles))
        if offset is None:
            raise RuntimeError(f"the log {seed} of {robot} determines no offset")
        # Rates of the model are half a step older than its angles.
        error = abs(offset.value - OFFSET - drift * offset.time - 0.5 * SIM_DT)
        drifted = abs(offset.drift - drift)
        found.append((error, error / offset.error, drifted, drifted / offset.drift_error))
    return [max(column) for column in zip(*found, strict=True)]


def markdown(robots: Sequence[str] = tuple(ROBOTS), logs: int = 8, seconds: float = 10.0, drift: float = 0.0) -> str:
    """The table; with the drift if there is one."""
    rows = []
    for robot in robots:
        for control_dt in (0.005, 0.01):
            worst, relative, drifted, of_drift = errors(robot, control_dt, logs, seconds, drift)
            row = [robot, f"{1e3 * control_dt:g} ms", f"{1e3 * worst:.2f} ms", f"{relative:.1f}"]
            rows.append([*row, *([f"{1e6 * drifted:.1f} ppm", f"{of_drift:.1f}"] if drift else [])])
    of_drift_titles = ["largest error of the drift", "in standard errors"] if drift else []
    return table(["robot", "rows", f"largest error of {logs} logs", "in standard errors", *of_drift_titles], rows)


if __name__ == "__main__":
    print(markdown())
    print(f"\nLogs of {LONG:g} s with a drift of {1e6 * DRIFT:g} ppm:\n")
    print(markdown(logs=4, seconds=LONG, drift=DRIFT))
