"""What differentiable batches share, whichever library differentiates their states."""

import abc
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.optimal import tangent
from ballbot_rs.optimal.held_motors import HeldMotors

Tensor = TypeVar("Tensor")


class DifferentiableRobots(abc.ABC, Generic[Tensor]):
    """Robots of a batch whose states a library of arrays differentiates."""

    _library: Any

    def __init__(self, batch: Batch) -> None:
        if not isinstance(batch, Batch):
            raise TypeError(f"batch must be a Batch, not {type(batch).__name__}: make one first, as Batch(64)")
        options = batch.options
        events = [event["term"] for event in options["events"]]
        pushed = batch.task == "push" or "push" in events
        motors = [term for term in events if term.startswith("actuators.") or term == "max_wheel_torque"]
        # They change the robot within a step, before its motion.
        later = [event["term"] for event in options["events"] if event["mode"] != "reset"]
        for fits, what in [
            (batch.model == "contact", f"the model {batch.model}: expected 'contact'"),
            (batch.autoreset == "same_step", f"autoreset={batch.autoreset!r}: expected 'same_step'"),
            (not motors, f"events that change the motors: {', '.join(motors)}"),
            (not pushed, "pushes, which the derivatives do not include"),
            (not later, f"events within an episode: {', '.join(later)}"),
        ]:
            if not fits:
                raise InvalidInputError(f"a differentiable batch cannot have {what}")
        self.batch = batch
        self._limits = batch.action_torques[:, None]
        self._motors = HeldMotors(options["actuators"], batch.sim_dt, batch.substeps)
        self._motor_rows = np.zeros((batch.num_envs, self._motors.width))
        #: Count of numbers of a state: of `State.to_array`, then of its motors.
        self.width = tangent.NUMBERS + self._motors.width

    def reset(self, seeds: Any = None) -> Tensor:
        """Begins new episodes, as `Batch.reset`, and returns the first states."""
        self.batch.reset(seeds=seeds)
        self._motor_rows[:] = 0.0
        return self.states()

    def states(self) -> Tensor:
        """The current states, detached: `step` records gradients from here on."""
        return self._tensor(self._present())

    def _present(self) -> npt.NDArray[np.float64]:
        return np.hstack([self.batch.states(), self._motor_rows])

    @classmethod
    def deviations(cls, states: Any) -> Tensor:
        """Policy inputs from states, shape (n, 9): deviations from rest at the origin, upright, in the heading frame.

        Position (2, m), tilt about x and y (2, sine), velocity (2, m/s), and rates of the body (3, rad/s).
        """
        w, x, y, z = (states[:, i] for i in range(16, 20))
        sine, cosine = 2.0 * w * z / (w**2 + z**2), (w**2 - z**2) / (w**2 + z**2)

        def turned(along_x: Any, along_y: Any) -> tuple[Any, Any]:
            return cosine * along_x + sine * along_y, cosine * along_y - sine * along_x

        position, velocity = turned(states[:, 0], states[:, 1]), turned(states[:, 7], states[:, 8])
        # The body leans towards +x by a rotation about +y.
        tilt = turned(2.0 * (w * x - y * z), 2.0 * (x * z + w * y))
        rates = (states[:, i] for i in range(23, 26))
        stacked: Tensor = cls._library.stack([*position, *tilt, *velocity, *rates], 1)
        return stacked

    def step(self, states: Any, wheel_torques: Any) -> tuple[Tensor, Tensor]:
        """Advances by one control step: states and whether the episode ended, shape (n,), bool.

        Args:
            states: of the last step, or `states()`.
            wheel_torques: shape (n, 3), N·m, within the torque of an action, `Batch.action_torques`.

        Raises:
            ValueError: states other than the current states, or torques that are out of range.
        """
        return self._linked(self._tensor(states), self._tensor(wheel_torques))

    @abc.abstractmethod
    def _tensor(self, numbers: Any) -> Tensor:
        """Numbers as float64 of the library."""

    @abc.abstractmethod
    def _linked(self, states: Tensor, torques: Tensor) -> tuple[Tensor, Tensor]:
        """States and ends of `_advance`, the states with its derivatives by the arguments."""

    def _check_shapes(self, states: tuple[int, ...], torques: tuple[int, ...]) -> None:
        n = self.batch.num_envs
        for name, shape, width in [("states", states, self.width), ("wheel_torques", torques, 3)]:
            if tuple(shape) != (n, width):
                raise InvalidInputError(f"{name} must have the shape ({n}, {width}), not {tuple(shape)}")

    def _advance(self, states: npt.ArrayLike, torques: npt.ArrayLike) -> tuple[npt.NDArray[Any], ...]:
        """Advances by one control step: states, ends, and derivatives of the states by the states and torques before.

        Shapes (n, width), (n,), (n, width, width) and (n, width, 3).
        """
        before, commands = np.asarray(states), np.asarray(torques)
        if not np.array_equal(before, self._present()):
            raise InvalidInputError("these are not the current states of the batch: pass what the last step returned")
        if not (np.abs(commands) <= self._limits).all():
            raise InvalidInputError(
                f"wheel_torques up to {np.abs(commands).max():g} N·m: must be within {self._limits.min():g} N·m; "
                "limit them in the policy, as with limit * tanh(...), so that the limit has its gradient"
            )
        actions = (commands / self._limits).astype(np.float32)
        inputs = self._motors.inputs(actions * self._limits, self._motor_rows)
        held = self._motors.torques(inputs)
        found = self.batch.jacobians(held, self.batch.substeps // held.shape[1])
        _, _, terminated, truncated = self.batch.step(actions)
        ended = terminated | truncated
        by_inputs = self._motors.next_by_inputs
        self._motor_rows = inputs.reshape(len(inputs), -1) @ by_inputs.T
        self._motor_rows[ended] = 0.0
        after = self._present()
        keep = (found.valid & ~ended)[:, None, None]
        # Contact forces of the last step, on which small losses depend, are left out.
        n, robot = tangent.COORDINATES, slice(0, tangent.NUMBERS)
        out = tangent.numbers_by_change(after[:, robot])
        by_states = np.zeros((len(after), self.width, self.width))
        by_states[:, robot, robot] = out @ found.A[:, :n, :n] @ tangent.change_by_numbers(before[:, robot])
        # By the command, then by what the motors keep.
        by_commands = np.empty((len(after), self.width, 3 + self._motors.width))
        by_commands[:, robot] = out @ self._motors.by_inputs(found.B[:, :n])
        by_commands[:, tangent.NUMBERS :] = by_inputs
        by_states[:, :, tangent.NUMBERS :] = by_commands[:, :, 3:]
        return after, ended, keep * by_states, keep * by_commands[:, :, :3]
