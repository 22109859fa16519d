"""The time-varying linear-quadratic regulator."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Lqr, Params, State, Terrain
from ballbot_rs.optimal import tangent

Array = npt.NDArray[np.float64]

#: Of `Lqr` on a terrain, 1/s.
LEAN_OBSERVER = 4.0


class TimeVaryingLqr:
    """Follows one motion: its torques plus feedback on the deviation from its states, with time-varying gains.

    ```python
    law = bb.optimize_trajectory((0.2, 0.0), seconds=1.4, control_dt=0.02).law()
    print(bb.simulate(law, pushes=bb.Push((0.1, 0.0, 0.0), time=0.5), seconds=2.0))
    ```

    Made by `OptimizedTrajectory.law()`. Each call is the next step of the motion, whatever the time; `reset()` starts
    it over. After the motion `Lqr` holds its last position and heading. It follows no setpoint. `simulate` runs it on
    the robot, the ground and the time step of the motion, unless they are given.
    """

    name = "tvlqr"

    def __init__(
        self,
        states: Array,
        torques: Array,
        gains: Array,
        *,
        robot: Params,
        terrain: Terrain | None,
        control_dt: float,
        sim_dt: float,
        max_torque: float,
    ) -> None:
        self._states, self._torques, self._gains = states, torques, gains
        self._max_torque = max_torque
        last = State.from_array(states[-1])
        self._last: dict[str, npt.ArrayLike] = {"position": last.ball_position[:2], "yaw": last.yaw}
        #: Time between two calls, s.
        self.control_dt = control_dt
        #: Options of the environment that the motion is for.
        self.env_options: dict[str, Any] = {"robot": robot, "control_dt": control_dt, "sim_dt": sim_dt}
        if terrain is not None:
            self.env_options["terrain"] = terrain
        self._step = 0
        self._after = self._holding()

    def _holding(self) -> Lqr:
        """A law that holds the last place: on a terrain it observes the lean that holds the robot there."""
        options: dict[str, Any] = {"lean_observer": LEAN_OBSERVER} if "terrain" in self.env_options else {}
        params = self.env_options["robot"]
        return Lqr(params, control_dt=self.control_dt, max_torque=self._max_torque, **options)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy needs; laws of the core are not copied, but made again."""
        return {name: value for name, value in vars(self).items() if name != "_after"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continues at the same step of the motion."""
        vars(self).update(state)
        self._after = self._holding()

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
