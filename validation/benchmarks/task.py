"""The balance task for the other engines, in NumPy, for any number of robots: start, observation, reward, end.

The definition is the same as `ballbot_rs.BalanceEnv`, deliberately derived independently of the Rust core:
`comparability.task_error` compares the two number by number, and agreement is evidence. Do not replace it by calls of
the core.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from ballbot_rs.engines.robot_geometry import Array, RobotGeometry
from validation.engines.rotations import attitude, to_body

Floats = npt.NDArray[np.float32]

MAX_TORQUE = 1.0  # of an action of 1, N·m
HEADLINE_TORQUE = 0.1  # default torque limit of the actions, N·m
MAX_EPISODE_STEPS = 1000
FALL_TILT = np.radians(20.0)
RESET_TILT, RESET_SPEED, RESET_RATE = np.radians(5.0), 0.1, 0.2  # rad, m/s, rad/s
#: Every simulator starts at this yaw, rad, where MuJoCo's friction directions coincide with the wheels' directions.
RESET_YAW = 0.0
SUCCESS_RADIUS = 0.1  # m

#: Bounds of the rows of an observation, their values at rest upright, and the magnitudes that divide them.
_BOUND = np.array([1.0] * 3 + [20.0] * 3 + [200.0] * 3 + [10.0] * 4 + [1.0] * 3)
_AT_REST = np.array([0.0, 0.0, -1.0] + [0.0] * 13)
_TYPICAL = np.array([0.1] * 3 + [1.0] * 3 + [5.0] * 3 + [0.1] * 2 + [0.2] * 2 + [0.5] * 3)
_SCALED_BOUND = 10.0


@dataclasses.dataclass(frozen=True)
class Sensed:
    """Quantities that the task reads from n robots."""

    attitude: Array  # of the bodies, (n, 4), [w, x, y, z]
    rate: Array  # of the bodies, body frame, (n, 3), rad/s
    wheel_speeds: Array  # (n, 3), rad/s
    position: Array  # of the balls, (n, 2), m
    velocity: Array  # of the balls, (n, 2), m/s

    def tilt(self) -> Array:
        """Angles between masts and the vertical, (n,), rad."""
        w, x, y, z = self.attitude.T
        return np.asarray(2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z)))


@dataclasses.dataclass(frozen=True)
class Starts:
    """Initial states of n episodes: rolling without slip, the ball at the origin."""

    attitude: Array  # (n, 4)
    rate: Array  # (n, 3), body frame, rad/s
    wheel_speeds: Array  # (n, 3), rad/s
    ball_velocity: Array  # (n, 3), m/s
    ball_rate: Array  # (n, 3), inertial frame, rad/s


def _disc(rng: np.random.Generator, n: int, radius: float) -> Array:
    """Points sampled uniformly from a disc, (n, 2)."""
    length, angle = radius * np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n)
    return np.stack([length * np.cos(angle), length * np.sin(angle)], axis=1)


def draw_starts(robot: RobotGeometry, rng: np.random.Generator, n: int) -> Starts:
    """Initial states of n episodes."""
    flat = np.zeros((n, 1))
    yaw = RESET_YAW * rng.uniform(-1.0, 1.0, n)
    quaternions = attitude(_disc(rng, n, RESET_TILT), yaw)
    velocity = np.hstack([_disc(rng, n, RESET_SPEED), flat])
    rate = np.hstack([_disc(rng, n, RESET_RATE), flat])
    ball_rate = np.stack([-velocity[:, 1], velocity[:, 0], flat[:, 0]], axis=1) / robot.params.ball_radius
    speeds = (to_body(quaternions, ball_rate) - rate) @ robot.wheel_map.T
    return Starts(quaternions, rate, speeds, velocity, ball_rate)


def observe(sensed: Sensed, last_action: Floats) -> Floats:
    """Scaled observations, (n, 16); the heading frame has the robot's yaw."""
    w, x, y, z = sensed.attitude.T
    out = np.empty((len(w), 16))
    out[:, 0] = 2.0 * (w * y - x * z)
    out[:, 1] = -2.0 * (y * z + w * x)
    out[:, 2] = 2.0 * (x * x + y * y) - 1.0
    out[:, 3:6] = sensed.rate
    out[:, 6:9] = sensed.wheel_speeds
    upright = w * w + z * z
    cos, sin = (w * w - z * z) / upright, 2.0 * w * z / upright
    for column, vector in ((9, sensed.position), (11, sensed.velocity)):
        out[:, column] = cos * vector[:, 0] + sin * vector[:, 1]
        out[:, column + 1] = cos * vector[:, 1] - sin * vector[:, 0]
    out[:, 13:] = last_action
    np.clip(out, -_BOUND, _BOUND, out=out)
    out -= _AT_REST
    out /= _TYPICAL
    np.clip(out, -_SCALED_BOUND, _SCALED_BOUND, out=out)
    # Only a diverged robot has one; checking is cheaper than replacing.
    return (np.nan_to_num(out, copy=False) if np.isnan(out.sum()) else out).astype(np.float32)


def reward_and_fall(sensed: Sensed, action: Floats, last_action: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Rewards (n,) of a step and whether it ended in a fall (n,)."""
    tilt = sensed.tilt()
    distance = np.einsum("ij,ij->i", sensed.position, sensed.position)
    fallen = ~(tilt <= FALL_TILT) | ~np.isfinite(distance)
    change = action - last_action
    reward = 1.0 - fallen - np.minimum((tilt / FALL_TILT) ** 2, 1.0)
    reward -= 0.5 * distance / (distance + SUCCESS_RADIUS**2)
    reward -= 0.2 * np.minimum(np.einsum("ij,ij->i", sensed.velocity, sensed.velocity), 1.0)
    reward -= 0.01 * np.minimum(np.einsum("ij,ij->i", sensed.rate, sensed.rate), 100.0)
    effort = np.einsum("ij,ij->i", action, action) + np.einsum("ij,ij->i", change, change)
    reward -= (0.02 / 3.0) * effort
    return reward.astype(np.float32), fallen


def make_actions(steps: int, num_envs: int, torque: float = HEADLINE_TORQUE) -> Floats:
    """The same random actions for every simulator, (steps, num_envs, 3), of ±`torque` (N·m)."""
    largest = torque / MAX_TORQUE
    return np.random.default_rng(0).uniform(-largest, largest, (steps, num_envs, 3)).astype(np.float32)
