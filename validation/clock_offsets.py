"""Errors of the estimated clock offset between IMU and encoders, for logs of the presets.

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


def errors(robot: str, control_dt: float, logs: int = 8) -> tuple[float, float]:
    """The largest error of the offsets of logs of 10 s, and the largest in standard errors, s."""
    found = []
    for seed in range(logs):
        log = bb.record_log(robot, 10.0, sim_dt=SIM_DT, control_dt=control_dt, seed=seed)
        imu = Series("gyro", "imu", log.time + OFFSET, log.gyro)
        offset = estimated(imu, Series("wheel_angles", "encoders", log.time, log.wheel_angles))
        if offset is None:
            raise RuntimeError(f"the log {seed} of {robot} determines no offset")
        # Rates of the model are half a step older than its angles.
        error = abs(offset.value - OFFSET - 0.5 * SIM_DT)
        found.append((error, error / offset.error))
    worst, relative = (max(column) for column in zip(*found, strict=True))
    return worst, relative


def markdown(robots: Sequence[str] = tuple(ROBOTS), logs: int = 8) -> str:
    """The table."""
    rows = []
    for robot in robots:
        for control_dt in (0.005, 0.01):
            worst, relative = errors(robot, control_dt, logs)
            rows.append([robot, f"{1e3 * control_dt:g} ms", f"{1e3 * worst:.2f} ms", f"{relative:.1f}"])
    return table(["robot", "rows", f"largest error of {logs} logs", "in standard errors"], rows)


if __name__ == "__main__":
    print(markdown())
