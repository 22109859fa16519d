"""Generalized advantage estimation over many fragments at once. Only arrays: no torch, no Ray."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]


def joined(arrays: Sequence[npt.NDArray[Any]]) -> Floats:
    """Concatenated arrays, as writable float32."""
    return np.concatenate(arrays).astype(np.float32, copy=False)


def without_last(lengths: Sequence[int]) -> npt.NDArray[np.bool_]:
    """Which rows of joined observations have an action: the first n of the n + 1 of a fragment."""
    mask = np.ones(sum(lengths) + len(lengths), dtype=bool)
    mask[np.cumsum(np.asarray(lengths) + 1) - 1] = False
    return mask


def advantages(
    rewards: Floats,
    values: Floats,
    lengths: Sequence[int],
    terminated: Sequence[bool],
    *,
    gamma: float,
    gae_lambda: float,
) -> tuple[Floats, Floats]:
    """Advantages and targets of the value function, shape (steps,) each.

    Args:
        rewards: of all fragments, concatenated.
        values: of their observations, one more per fragment than rewards.
        lengths: number of steps of each fragment.
        terminated: whether its last step ended the episode; the value after it is then zero.
        gamma: discount.
        gae_lambda: decay of the sum over steps.
    """
    count, longest = len(lengths), max(lengths)
    is_step = np.arange(longest) < np.asarray(lengths)[:, None]
    first = without_last(lengths)
    following = values[np.flatnonzero(first) + 1]
    following[np.cumsum(lengths)[np.asarray(terminated)] - 1] = 0.0
    # Zeros after the end of a fragment.
    errors = np.zeros((count, longest), dtype=np.float32)
    errors[is_step] = rewards + np.float32(gamma) * following - values[first]
    decay = np.float32(gamma * gae_lambda)
    for step in range(longest - 2, -1, -1):
        errors[:, step] += decay * errors[:, step + 1]
    found = errors[is_step]
    return found, found + values[first]
