"""Small experiments with a closed-form result, on any engine's robot."""

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array, RobotGeometry
from validation.engines.any_robot import AnyRobot
from validation.engines.our_robot import OurRobot
from validation.engines.rotations import matrix
from validation.engines.steps import SUBSTEPS

#: A tilt that stays small, rad, and how often and how far apart it is read, s.
_TILT, _READINGS, _APART = 1e-3, 3, 0.2
#: Torque on one wheel, N·m, far below slip, and its duration, s.
_TORQUE, _PUSHED = 0.1, 0.02
#: Torque on each wheel, N·m, twice the slip limit, and the measurement time, s.
_SLIPPING, _SLIPS = 1.0, 0.01


def advance(robot: AnyRobot, torques: Array, seconds: float) -> None:
    """Steps for `seconds` under wheel torques (3, N·m), as often as actions do."""
    left = round(seconds / robot.sim_dt)
    while left:
        steps = min(left, SUBSTEPS)
        robot.step(torques, steps)
        left -= steps


def growth(robot: AnyRobot, params: bb.Params, yaw: float, azimuth: float, tilt: float = _TILT) -> float:
    """Growth rate λ of a tilt from rest, 1/s."""
    robot.reset(bb.State.at_rest(params, tilt * np.array([np.cos(azimuth), np.sin(azimuth)]), yaw))
    tilts = []
    for _ in range(_READINGS):
        advance(robot, np.zeros(3), _APART)
        mast = matrix(np.asarray(robot.sense()[0]))[:, 2]
        tilts.append(float(np.hypot(mast[0], mast[1])))
    return growth_rate(tilts[0], tilts[1], tilts[2], _APART)


def growth_rate(before: float, at: float, after: float, apart: float) -> float:
    """λ by cosh λh = (θ₋ + θ₊) / 2θ of tilts at three times h apart, 1/s.

    That holds for any amount of the decaying part, which the half step between rates and attitude of semi-implicit
    engines would change. Zero for a tilt that does not grow.
    """
    return float(np.arccosh(max(1.0, (before + after) / (2.0 * at))) / apart)


def drive(robot: AnyRobot, params: bb.Params, yaw: float, wheel: int) -> tuple[float, float]:
    """Initial motion of a ball when one wheel is driven: angle to the exact motion (deg) and ratio of its speed."""
    start, exact = bb.State.at_rest(params, yaw=yaw), OurRobot("spatial", params, robot.sim_dt)
    torques = np.zeros(3)
    torques[wheel] = _TORQUE
    velocities = []
    pair: tuple[AnyRobot, AnyRobot] = (robot, exact)
    for one in pair:
        one.reset(start)
        # Contacts of the rigid engines take up their load first.
        advance(one, np.zeros(3), _PUSHED)
        advance(one, torques, _PUSHED)
        velocities.append(np.array(one.sense()[4]))
    found, expected = velocities
    cross, dot = found[0] * expected[1] - found[1] * expected[0], found @ expected
    return float(np.degrees(abs(np.arctan2(cross, dot)))), float(np.hypot(*found) / np.hypot(*expected))


def slip_limit(robot: AnyRobot, model: RobotGeometry, yaw: float) -> float:
    """Mean traction of slipping wheels over load times friction coefficient: 1 is Coulomb's."""
    p = model.params
    robot.reset(bb.State.at_rest(p, yaw=yaw))
    advance(robot, np.zeros(3), _PUSHED)
    torques, spins = np.full(3, _SLIPPING), []
    for _ in range(2):
        advance(robot, torques, _SLIPS)
        _, rate, speeds, _, _ = robot.sense()
        spins.append(np.asarray(speeds) + model.axles @ np.asarray(rate))
    spun_up = p.wheel_inertia * (spins[1] - spins[0]) / _SLIPS
    return float(np.mean(torques - spun_up) / (p.wheel_radius * p.wheel_dynamic_friction * resting_load(p)))


def resting_load(params: bb.Params) -> float:
    """Load of each wheel of the robot upright at rest, M_b g/(3 cos α), N."""
    return float(params.body_mass * params.gravity / (3.0 * np.cos(params.wheel_zenith)))


def wheel_loads(robot: AnyRobot, params: bb.Params) -> Array:
    """Loads of the wheels (3, N) of the robot upright at rest, after 0.3 s."""
    robot.reset(bb.State.at_rest(params))
    for _ in range(round(0.3 / robot.sim_dt)):
        robot.step(np.zeros(3), 1)
    return np.asarray(robot.wheel_loads())
