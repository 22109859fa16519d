"""The errors of a fit to a teacher: their weights, and how fast the fit follows them."""

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import torch

from ballbot_rs._core import Batch
from ballbot_rs._state_rows import mast_of
from ballbot_rs.training.config import Teacher

#: A law's actions, shape (n, 3), and the factors of their errors, shape (n,).
Labels: TypeAlias = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]

#: Action from which on it is the largest, but for rounding.
LARGEST = 1.0 - 1e-6


class Weighting:
    """Factors of the errors of a batch of robots."""

    def __init__(self, batch: Batch, teacher: Teacher) -> None:
        robots = [batch.nominal_params(i) for i in range(batch.num_envs)]
        powers = teacher.weights.items()
        weights = np.array([math.prod(robot.scale(unit) ** power for unit, power in powers) for robot in robots])
        self._factors: npt.NDArray[np.float32] = np.sqrt((weights / weights.mean()).astype(np.float32))
        self._small = teacher.small_action
        most = teacher.largest_tilt
        self._most = None if most is None else np.array([math.cos(most * robot.scale("rad")) for robot in robots])

    def of(self, batch: Batch, actions: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """The factor of each robot's error in its present state, where the law has these actions."""
        factors = self._factors
        if self._small is not None:
            factors = factors / np.sqrt(np.maximum(np.abs(actions).max(axis=1), np.float32(self._small)))
        return factors if self._most is None else np.where(mast_of(batch.states())[:, 2] < self._most, 0.0, factors)


def mean_square(actions: torch.Tensor, expected: torch.Tensor, weight: torch.Tensor, teacher: Teacher) -> torch.Tensor:
    """The mean square of the weighted errors of actions."""
    if teacher.saturates:
        side = torch.where(expected.abs() > LARGEST, expected.sign(), 0.0)
        actions = torch.where(side * actions > 1.0, side, actions)
    return torch.nn.functional.mse_loss(weight * actions, weight * expected)


def epochs_of(teacher: Teacher, done: int) -> int:
    """Of the fit after `done` rounds."""
    is_last = done + 1 == teacher.rounds
    return teacher.epochs if teacher.last_epochs is None or not is_last else teacher.last_epochs


def set_rate(optimizer: torch.optim.Optimizer, teacher: Teacher, done: int, epochs: float) -> None:
    """Sets the learning rate after `done` rounds and so many epochs of the next fit."""
    passed = done / teacher.rounds
    if teacher.last_epochs is not None:
        # A fit has the states of all rounds so far.
        updates = [epochs_of(teacher, earlier) * (earlier + 1) for earlier in range(teacher.rounds)]
        passed = (sum(updates[:done]) + epochs * (done + 1)) / sum(updates)
    for group in optimizer.param_groups:
        group["lr"] = teacher.learning_rate * (1.0 - passed)
