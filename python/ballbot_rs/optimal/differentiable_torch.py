"""Batches whose motion PyTorch differentiates."""

from typing import Any

import torch
from torch.autograd.function import once_differentiable

from ballbot_rs._keywords import named
from ballbot_rs.optimal.differentiable import DifferentiableRobots


@named
class DifferentiableBatch(DifferentiableRobots[torch.Tensor]):
    """Robots of a batch whose states PyTorch differentiates, through contact and slip.

    ```python
    import torch

    robots = bb.DifferentiableBatch(bb.Batch(4))
    states = robots.reset([0, 1, 2, 3])
    torques = torch.zeros((4, 3), dtype=torch.float64, requires_grad=True)
    after, ended = robots.step(states, torques)
    after[:, 0].sum().backward()  # the balls' position x
    print(torques.grad)
    ```

    For training policies with gradients through the simulation::

        robots = DifferentiableBatch(Batch(64))
        states = robots.reset(seeds)
        for _ in range(32):
            states, ended = robots.step(states, policy(states))
            loss = loss + cost(states)[~ended].sum()
        loss.backward()

    States are float64 tensors, shape (n, width), rows as `State.to_array`; motors with delay or lag add the commands in
    transit, newest first, and the torques of the lag, three each, N·m. The gradients are exact with the modes that the
    contacts took, as `Batch.jacobians`, along changes that leave quaternions of unit length. A robot whose episode ends
    starts another, and its new state has no gradient; neither has the state of a robot whose bot touches the floor. A
    step takes about 260 times as long as `Batch.step`, and twice as long with a lag (docs/gradients.md).

    `torch.utils.checkpoint` of a policy works; of `step` it is an error in the backward pass, because the robots cannot
    repeat a step.

    Args:
        batch: in the model "contact", with `autoreset` "same_step" and without pushes; of the effects of motors with
            `delay`, `strength` and `lag` only. From here on only `reset` and `step` of this object move it.

    Raises:
        ValueError: another batch.
    """

    _library = torch

    def _tensor(self, numbers: Any) -> torch.Tensor:
        return torch.as_tensor(numbers, dtype=torch.float64)

    def _linked(self, states: torch.Tensor, torques: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        self._check_shapes(states.shape, torques.shape)
        found = self._advance(states.detach(), torques.detach())
        after, ended, *matrices = (torch.from_numpy(array) for array in found)
        return _Step.apply(states, torques, after, *matrices), ended


class _Step(torch.autograd.Function):
    """States with known derivatives by the states and torques before."""

    @staticmethod
    def forward(
        ctx: Any, _states: torch.Tensor, _torques: torch.Tensor, after: torch.Tensor, *matrices: torch.Tensor
    ) -> torch.Tensor:
        ctx.save_for_backward(*matrices)
        return after

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        row = gradient[:, None]
        return (*((row @ matrix)[:, 0] for matrix in ctx.saved_tensors), None, None, None)
