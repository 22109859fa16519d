"""The time-varying linear-quadratic regulator."""

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Lqr, State
from ballbot_rs.optimal import tangent

Array = npt.NDArray[np.float64]


class TimeVaryingLqr:
    """Follows one motion: its torques, and feedback on the difference from its states, with gains for each step.

    Made by `OptimizedTrajectory.law()`. Each call is the next step of the motion; `reset()` starts it over. After the
    motion `Lqr` holds its last position and heading. It follows no setpoint.
    """

    name = "tvlqr"

    def __init__(self, states: Array, torques: Array, gains: Array, after: Lqr, max_torque: float) -> None:
        self._states, self._torques, self._gains = states, torques, gains
        self._max_torque = max_torque
        last = State.from_array(states[-1])
        self._last: dict[str, npt.ArrayLike] = {"position": last.ball_position[:2], "yaw": last.yaw}
        self._after = after
        #: Time between two calls, s.
        self.control_dt = after.control_dt
        self._step = 0

    def reset(self) -> None:
        """Starts the motion over."""
        self._step = 0
        self._after.reset()

    def __call__(self, state: State) -> Array:
        """Wheel torques for the next step, shape (3,), N·m."""
        step = self._step
        if step == len(self._torques):
            return np.asarray(self._after(state, self._last))
        self._step += 1
        error = tangent.difference(state.to_array(), self._states[step])
        torques = self._torques[step] + self._gains[step] @ error
        # Scaled down together, so that their direction stays.
        return np.asarray(torques * min(1.0, self._max_torque / max(float(np.abs(torques).max()), 1e-300)))
