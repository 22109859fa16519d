"""Whether an engine's robot is a working ballbot: loads, growth of a small tilt, drive direction, slip limit."""

from typing import Any

import numpy as np

from ballbot_rs.engines.robot_geometry import robot_geometry
from validation.engines import probes
from validation.engines.any_robot import AnyRobot
from validation.mechanics import unstable_pole


def accuracy(robot: AnyRobot, headings: int) -> dict[str, Any]:
    """Probes of the paper's robot in an engine at yaw 0 and over evenly spaced headings, versus the closed forms."""
    geometry = robot_geometry()
    params = geometry.params
    yaws = np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False)
    growth = {float(yaw): [probes.growth(robot, params, yaw, azimuth) for azimuth in yaws[::2]] for yaw in yaws}
    drive = {float(yaw): [probes.drive(robot, params, yaw, wheel) for wheel in range(3)] for yaw in yaws}
    slip = [probes.slip_limit(robot, geometry, yaw) for yaw in yaws]
    loads = probes.wheel_loads(robot, params)
    return {
        "wheel_load": loads.tolist(),
        "exact_wheel_load": probes.resting_load(params),
        "growth_yaw_0": _extremes(growth[0.0]),
        "growth_all_yaws": _extremes([value for values in growth.values() for value in values]),
        "exact_growth": unstable_pole(params),
        "drive_direction_error_yaw_0_deg": max(angle for angle, _ in drive[0.0]),
        "drive_direction_error_all_yaws_deg": max(angle for values in drive.values() for angle, _ in values),
        "slip_limit_yaw_0": slip[0],
        "slip_limit_all_yaws": _extremes(slip),
        "drive_strength_yaw_0": _extremes([strength for _, strength in drive[0.0]]),
        "drive_strength_all_yaws": _extremes([strength for values in drive.values() for _, strength in values]),
    }


def _extremes(values: list[float]) -> list[float]:
    """Smallest, median and largest."""
    return [float(np.min(values)), float(np.median(values)), float(np.max(values))]
