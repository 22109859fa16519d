"""Recurrent policies: each robot has a state, which is zero where an episode begins."""

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.float32]

#: Actions in [-1, 1], shape (n, 3), for observations, shape (n, m).
Feedforward: TypeAlias = Callable[[Rows], npt.ArrayLike]


@runtime_checkable
class Recurrent(Protocol):
    """A policy with a state."""

    def initial_state(self, count: int) -> Rows:
        """The state where an episode begins, shape (count, k)."""

    def step(self, observation: Rows, state: Rows) -> tuple[npt.ArrayLike, Rows]:
        """Actions in [-1, 1], shape (n, 3), and next states, (n, k), for observations (n, m) and states (n, k)."""


Policy: TypeAlias = Feedforward | Recurrent


class PolicyMemory:
    """A policy on robots, with the state of each.

    Args:
        policy: with or without a state.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy: Any = policy
        self._is_recurrent = isinstance(policy, Recurrent)
        self._state: Rows | None = None

    def act(self, observations: Rows) -> npt.ArrayLike:
        """Actions for the next observation of each robot, shape (n, m)."""
        if not self._is_recurrent:
            actions: npt.ArrayLike = self._policy(observations)
            return actions
        if self._state is None:
            self._state = self._policy.initial_state(len(observations))
        actions, self._state = self._policy.step(observations, self._state)
        return actions

    def reset(self, mask: npt.NDArray[np.bool_] | None = None) -> None:
        """Begins an episode of all robots, or of the robots in a mask of shape (n,)."""
        if mask is None:
            self._state = None
        elif self._state is not None:
            # Not in place: the state may belong to others, too.
            fresh = self._policy.initial_state(len(self._state))
            self._state = np.where(mask[:, np.newaxis], fresh, self._state)
