"""What differentiable batches share, whichever library differentiates their states."""

import abc
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.optimal import tangent

Tensor = TypeVar("Tensor")


class DifferentiableRobots(abc.ABC, Generic[Tensor]):
    """Robots of a batch whose states a library of arrays differentiates."""

    _library: Any

    def __init__(self, batch: Batch) -> None:
        pushed = batch.task == "push" or any(event["term"] == "push" for event in batch.options["events"])
        for fits, what in [
            (batch.model == "contact", f"the model {batch.model}: only contact has derivatives"),
            (batch.autoreset == "same_step", f"autoreset={batch.autoreset!r}: expected 'same_step'"),
            (batch.options["actuators"] is None, "actuators: derivatives are without the model of the motors"),
            (not pushed, "pushes, which the derivatives do not know"),
        ]:
            if not fits:
                raise InvalidInputError(f"a differentiable batch cannot have {what}")
        self.batch = batch
        self._limits = batch.action_torques[:, None]

    def reset(self, seeds: Any = None) -> Tensor:
        """Begins new episodes, as `Batch.reset`, and returns the first states."""
        self.batch.reset(seeds=seeds)
        return self.states()

    def states(self) -> Tensor:
        """The present states, without gradient: from here on `step` differentiates."""
        return self._tensor(self.batch.states())

    @classmethod
    def deviations(cls, states: Any) -> Tensor:
        """What a policy needs of states, shape (n, 9): from rest upright at the origin, in the heading frame.

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
            ValueError: other states than the present states, or torques that are out of range.
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
        for name, shape, width in [("states", states, tangent.NUMBERS), ("wheel_torques", torques, 3)]:
            if tuple(shape) != (n, width):
                raise InvalidInputError(f"{name} must have the shape ({n}, {width}), not {tuple(shape)}")

    def _advance(self, states: npt.ArrayLike, torques: npt.ArrayLike) -> tuple[npt.NDArray[Any], ...]:
        """Advances by one control step: states, ends, and derivatives of the states by the states and torques before.

        Shapes (n, 32), (n,), (n, 32, 32) and (n, 32, 3).
        """
        before, held = np.asarray(states), np.asarray(torques)
        if not np.array_equal(before, self.batch.states()):
            raise InvalidInputError(
                "the states are not the present states of the batch: pass what the last step returned"
            )
        if not (np.abs(held) <= self._limits).all():
            raise InvalidInputError(
                f"wheel_torques up to {np.abs(held).max():g} N·m: must be within {self._limits.min():g} N·m; "
                "limit them in the policy, as with limit * tanh(...), so that the limit has its gradient"
            )
        actions = (held / self._limits).astype(np.float32)
        found = self.batch.jacobians(actions * self._limits, self.batch.substeps)
        _, _, terminated, truncated = self.batch.step(actions)
        ended, after = terminated | truncated, self.batch.states()
        keep = (found.valid & ~ended)[:, None, None]
        # Contact forces of the last step, on which small losses depend, are left out.
        n = tangent.COORDINATES
        out = tangent.numbers_by_change(after)
        by_states = out @ (keep * found.A[:, :n, :n]) @ tangent.change_by_numbers(before)
        return after, ended, by_states, out @ (keep * found.B[:, :n])
