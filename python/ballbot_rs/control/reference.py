"""A reference between the goal of a user and a controller: a target that the controller can follow.

With a far setpoint a controller leans more than the traction allows, and falls. The target of a `Reference` moves to
the goal with limited speed and acceleration, and is never farther from the ball than a lead that leaves the controller
torque in reserve.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: The largest lead, m, and the step of its search.
MAX_LEAD = 0.4
LEAD_STEP = 0.02

#: Directions in which the torque is checked: wheels are a third of a turn apart.
DIRECTIONS = 12

#: The target covers at most this many leads per second, and takes at least a second to reach that speed.
RATE = 2.0


def largest_lead(torques: Callable[[FloatArray], npt.ArrayLike], limit: float) -> float:
    """The distance to a target, m, below which a controller's torques on the upright robot at rest stay below a limit.

    Args:
        torques: wheel torques, N·m, for the robot at rest with its ball at the origin and a target (x, y), m.
        limit: largest torque of a wheel, N·m, usually that at which a wheel slips.

    Returns:
        A multiple of `LEAD_STEP`, from `LEAD_STEP` to `MAX_LEAD`.

    Raises:
        ValueError: a limit that is not positive.
    """
    if not limit > 0.0:
        raise ValueError(f"limit = {limit}: it must be positive")
    angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    lead = LEAD_STEP
    for step in range(2, round(MAX_LEAD / LEAD_STEP) + 1):
        farther = step * LEAD_STEP
        # A controller that keeps to the same limit reaches it up to rounding.
        if any(np.abs(torques(farther * direction)).max() >= (1.0 - 1e-6) * limit for direction in directions):
            break
        lead = farther
    return lead


class Reference:
    """A target on its way to a goal.

    Args:
        lead: largest distance of the target from the ball, m; it also sets the limits of speed and acceleration.

    Raises:
        ValueError: a lead that is not positive and finite.
    """

    def __init__(self, lead: float) -> None:
        if not 0.0 < lead < math.inf:
            raise ValueError(f"lead = {lead}: it must be positive and finite")
        self.lead = lead
        self.max_speed = RATE * lead
        self.max_acceleration = RATE * lead
        self.start((0.0, 0.0), (0.0, 0.0))

    def start(self, ball: npt.ArrayLike, velocity: npt.ArrayLike) -> None:
        """Begins at the position of a ball, m, with its velocity, m/s."""
        moving = np.asarray(velocity, dtype=np.float64)
        self._velocity = _within(moving, self.max_speed)
        self.position: FloatArray = np.asarray(ball, dtype=np.float64) + _within(moving / RATE, self.lead)

    def advance(self, goal: npt.ArrayLike, ball: npt.ArrayLike, seconds: float) -> FloatArray:
        """The target, shape (2,), m, after a time step of `seconds` towards the goal, m, for the ball's position, m."""
        way = np.asarray(goal, dtype=np.float64) - self.position
        distance = float(np.linalg.norm(way))
        # The speed from which the target can still stop at the goal after this step: v²/2a + v dt = distance.
        brakes = math.hypot(seconds, math.sqrt(2.0 * distance / self.max_acceleration)) - seconds
        speed = min(self.max_speed, self.max_acceleration * brakes)
        desired = way * (speed / distance) if distance > 0.0 else np.zeros(2)
        self._velocity = self._velocity + _within(desired - self._velocity, self.max_acceleration * seconds)
        ahead = self.position + seconds * self._velocity - np.asarray(ball, dtype=np.float64)
        self.position = np.asarray(ball, dtype=np.float64) + _within(ahead, self.lead)
        return self.position


def _within(vector: FloatArray, length: float) -> FloatArray:
    """The vector, shortened to a length."""
    norm = float(np.linalg.norm(vector))
    return vector * (length / norm) if norm > length else vector
