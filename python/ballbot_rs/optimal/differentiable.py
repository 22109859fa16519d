"""Batches whose motion PyTorch differentiates."""

from typing import Any

import numpy as np
import torch

from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.optimal import tangent


class DifferentiableBatch:
    """Robots of a batch whose states PyTorch differentiates, through contact and slip.

    For policies that follow the gradient of what their robots do:

        robots = DifferentiableBatch(Batch(64))
        states = robots.reset(seeds)
        for _ in range(32):
            states, ended = robots.step(states, policy(states))
            loss = loss + cost(states)[~ended].sum()
        loss.backward()

    States are float64 tensors, shape (n, 32), rows as `State.to_array`. The gradients are exact with the modes that the
    contacts took, as `Batch.jacobians`, along changes that leave quaternions of unit length. A robot whose episode ends
    starts another, and its new state has no gradient; neither has the state of a robot whose bot touches the floor. A
    step takes as long as 25 steps without derivatives.

    Args:
        batch: in the model "contact", with `autoreset` "same_step", ideal motors and without pushes.

    Raises:
        ValueError: another batch.
    """

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

    def reset(self, seeds: Any = None) -> torch.Tensor:
        """Begins new episodes, as `Batch.reset`, and returns the first states."""
        self.batch.reset(seeds=seeds)
        return self.states()

    def states(self) -> torch.Tensor:
        """The present states, without gradient: from here on `step` differentiates."""
        return torch.from_numpy(np.array(self.batch.states()))

    @staticmethod
    def deviations(states: torch.Tensor) -> torch.Tensor:
        """What a policy needs of states, shape (n, 9): from rest upright at the origin, in the heading frame.

        Position (2, m), tilt about x and y (2, sine), velocity (2, m/s), and rates of the body (3, rad/s).
        """
        w, x, y, z = states[:, 16:20].unbind(1)
        sine, cosine = 2.0 * w * z / (w**2 + z**2), (w**2 - z**2) / (w**2 + z**2)

        def turned(along_x: torch.Tensor, along_y: torch.Tensor) -> torch.Tensor:
            return torch.stack([cosine * along_x + sine * along_y, cosine * along_y - sine * along_x], 1)

        # The body leans towards +x by a rotation about +y.
        tilt = turned(2.0 * (w * x - y * z), 2.0 * (x * z + w * y))
        return torch.cat([turned(*states[:, :2].T), tilt, turned(*states[:, 7:9].T), states[:, 23:26]], 1)

    def step(self, states: torch.Tensor, wheel_torques: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Advances by one control step: states and whether the episode ended, shape (n,), bool.

        Args:
            states: of the last step, or `states()`.
            wheel_torques: shape (n, 3), N·m, within the torque of an action, `Batch.action_torques`.

        Raises:
            ValueError: other states than the present states, or torques that are out of range.
        """
        before, now = states.detach().numpy(), self.batch.states()
        if before.shape != now.shape or not np.array_equal(before, now):
            raise InvalidInputError(
                "the states are not the present states of the batch: pass what the last step returned"
            )
        torques = wheel_torques.detach().double().numpy()
        fits = torques.shape == (len(now), 3) and bool((np.abs(torques) <= self._limits).all())
        if not fits:
            raise InvalidInputError(
                f"wheel_torques must have the shape ({len(now)}, 3) and be within {self._limits.min():g} N·m: "
                "limit them in the policy, as with limit * torch.tanh(...), so that the limit has its gradient"
            )
        actions = (torques / self._limits).astype(np.float32)
        found = self.batch.jacobians(actions * self._limits, self.batch.substeps)
        _, _, terminated, truncated = self.batch.step(actions)
        ended, after = terminated | truncated, np.array(self.batch.states())
        keep = (found.valid & ~ended)[:, None, None]
        # Contact forces of the last step, on which small losses depend, are left out.
        n = tangent.COORDINATES
        out = tangent.numbers_by_change(after)
        by_state = out @ (keep * found.A[:, :n, :n]) @ tangent.change_by_numbers(before)
        by_torques = out @ (keep * found.B[:, :n])
        matrices = torch.from_numpy(by_state), torch.from_numpy(by_torques)
        return _Step.apply(states, wheel_torques.double(), torch.from_numpy(after), *matrices), torch.from_numpy(ended)


class _Step(torch.autograd.Function):
    """States with known derivatives by the states and torques before."""

    @staticmethod
    def forward(
        ctx: Any, _states: torch.Tensor, _torques: torch.Tensor, after: torch.Tensor, *matrices: torch.Tensor
    ) -> torch.Tensor:
        ctx.save_for_backward(*matrices)
        return after

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        by_state, by_torques = ctx.saved_tensors
        row = gradient[:, None]
        return (row @ by_state)[:, 0], (row @ by_torques)[:, 0], None, None, None
