"""Motors with delay and lag: their torques are linear in the commands."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError

Array = npt.NDArray[np.float64]

#: What `HeldMotors` knows.
_LINEAR = ("delay", "strength", "lag")


class HeldMotors:
    """The torques of a control step, by its command, the commands in transit and the torque of the lag.

    The rows of a robot's motors, `width` numbers, are commands in transit, newest first, then the torque of the lag;
    of three wheels each, N·m. They are zero at the start of an episode.

    Args:
        options: of the actuators, `Batch.options["actuators"]`; None is ideal.
        sim_dt: s, the time step of the model.
        substeps: time steps in a control step.

    Raises:
        ValueError: effects other than delay, strength and lag.
    """

    def __init__(self, options: Mapping[str, Any] | None, sim_dt: float, substeps: int) -> None:
        for name, value in (options or {}).items():
            if name not in _LINEAR and value:
                raise InvalidInputError(
                    f"a differentiable batch cannot have actuators with {name} = {value}: only {', '.join(_LINEAR)}"
                )
        delay, lag = ((options or {}).get(name, 0.0) for name in ("delay", "lag"))
        strength = np.broadcast_to((options or {}).get("strength", 1.0), 3)
        whole, rest = divmod(round(delay / sim_dt), substeps)
        #: Commands in transit between two control steps.
        self.commands = whole + (rest > 0)
        self.has_lag = lag > 0.0
        #: Count of numbers of a robot's motors.
        self.width = 3 * (self.commands + self.has_lag)
        share = -np.expm1(-sim_dt / lag) if self.has_lag else 1.0
        #: Torque of each time step and wheel by the command, the commands in transit and the torque of the lag.
        self.gains = np.zeros((substeps, 3, 1 + self.commands + self.has_lag))
        torque = np.zeros((3, self.gains.shape[2]))
        if self.has_lag:
            torque[:, -1] = 1.0
        for step in range(substeps):
            arrived = np.zeros_like(torque)
            arrived[:, whole + (step < rest)] = strength
            torque = torque + share * (arrived - torque)
            self.gains[step] = torque
        #: The rows of the motors after a control step, by what torques depend on: shape (width, 3 k).
        self.next_by_inputs = self._next_by_inputs()
        if not (self.has_lag or rest):
            # The torque is constant over the control step.
            self.gains = self.gains[:1]

    def inputs(self, commands: Array, motors: Array) -> Array:
        """What torques depend on, shape (n, k, 3), from commands (n, 3) and the rows of the motors (n, width)."""
        return np.concatenate([commands[:, None], motors.reshape(len(motors), -1, 3)], 1)

    def torques(self, inputs: Array) -> Array:
        """Torques of each time step, or of all, shape (n, steps, 3)."""
        return np.asarray(np.einsum("swk,nkw->nsw", self.gains, inputs))

    def by_inputs(self, by_torques: Array) -> Array:
        """Derivatives by what torques depend on, shape (n, m, 3 k), from derivatives by torques, (n, m, 3 steps)."""
        n, m, _ = by_torques.shape
        return np.asarray(np.einsum("nmsw,swk->nmkw", by_torques.reshape(n, m, -1, 3), self.gains)).reshape(n, m, -1)

    def _next_by_inputs(self) -> Array:
        k = self.gains.shape[2]
        out = np.zeros((self.width // 3, 3, k, 3))
        for row in range(self.commands):
            out[row, range(3), row, range(3)] = 1.0
        if self.has_lag:
            out[-1, range(3), :, range(3)] = self.gains[-1]
        return out.reshape(self.width, 3 * k)
