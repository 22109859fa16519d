"""Columns of an array of states, whose rows are those of `State.to_array`."""

from typing import Final

import numpy as np
import numpy.typing as npt

BALL_POSITION: Final = slice(0, 3)
BALL_QUATERNION: Final = slice(3, 7)
BODY_POSITION: Final = slice(13, 16)
BODY_QUATERNION: Final = slice(16, 20)
WHEEL_ANGLES: Final = slice(26, 29)


def mast_of(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Unit vectors along the mast, inertial frame: shape (..., 3) for states (..., 32)."""
    w, x, y, z = np.moveaxis(states[..., BODY_QUATERNION], -1, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def body_axes_of(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rotations from the body frame to the inertial one: shape (..., 3, 3) for states (..., 32)."""
    w, x, y, z = np.moveaxis(states[..., BODY_QUATERNION], -1, 0)
    first = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1)
    second = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=-1)
    return np.stack([first, second, mast_of(states)], axis=-1)


def tilt_of(states: npt.NDArray[np.float64], com: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Tilts from the equilibrium, rad: shape (...) for states (..., 32).

    `com` is the CoM in the body frame, m, shape (3,), or one each.
    """
    com = np.asarray(com, dtype=np.float64)
    axis = np.einsum("...ij,...j->...i", body_axes_of(states), com) if com[..., :2].any() else mast_of(states)
    angle: npt.NDArray[np.float64] = np.arctan2(np.linalg.norm(axis[..., :2], axis=-1), axis[..., 2])
    return angle
