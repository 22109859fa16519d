"""Columns of an array of states, with rows as `State.to_array`."""

from typing import Final

import numpy as np
import numpy.typing as npt

BALL_POSITION: Final = slice(0, 3)
BALL_QUATERNION: Final = slice(3, 7)
BALL_VELOCITY: Final = slice(7, 10)
BALL_RATE: Final = slice(10, 13)
BODY_POSITION: Final = slice(13, 16)
BODY_QUATERNION: Final = slice(16, 20)
BODY_VELOCITY: Final = slice(20, 23)
BODY_RATE: Final = slice(23, 26)
WHEEL_ANGLES: Final = slice(26, 29)
WHEEL_SPEEDS: Final = slice(29, 32)


def mast_of(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Unit vectors along the mast, inertial frame: shape (..., 3) for states (..., 32)."""
    w, x, y, z = np.moveaxis(states[..., BODY_QUATERNION], -1, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def body_axes_of(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rotations from the body frame to the inertial frame: shape (..., 3, 3) for states (..., 32)."""
    w, x, y, z = np.moveaxis(states[..., BODY_QUATERNION], -1, 0)
    first = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1)
    second = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=-1)
    return np.stack([first, second, mast_of(states)], axis=-1)


def tilt_of(states: npt.NDArray[np.float64], com: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Tilts from the equilibrium, rad: shape (...) for states (..., 32).

    `com` is the CoM in the body frame, m, shape (3,), or one row per state.
    """
    axis = _balance_axis_of(states, com)
    angle: npt.NDArray[np.float64] = np.arctan2(np.linalg.norm(axis[..., :2], axis=-1), axis[..., 2])
    return angle


def tilt_components_of(states: npt.NDArray[np.float64], com: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rotation vectors (x, y), inertial frame, from the equilibrium to the attitude except for the yaw, rad.

    Shape (..., 2) for states (..., 32); for a CoM on the mast as `State.tilt_components`. `com` as in `tilt_of`.
    """
    axis = _balance_axis_of(states, com)
    length = np.linalg.norm(axis[..., :2], axis=-1)
    angle = np.arctan2(length, axis[..., 2])
    ratio = angle / np.where(length > 0.0, length, 1.0)
    components: npt.NDArray[np.float64] = np.stack([-axis[..., 1] * ratio, axis[..., 0] * ratio], axis=-1)
    return components


def tilt_rates_of(states: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rates of `State.tilt_components`, rad/s: shape (..., 2) for states (..., 32)."""
    mast = mast_of(states)
    rate = np.einsum("...ij,...j->...i", body_axes_of(states), states[..., BODY_RATE])
    change = np.cross(rate, mast)
    # The components are the horizontal part of the mast, rotated, times angle / length.
    length = np.linalg.norm(mast[..., :2], axis=-1)
    upright = length == 0.0
    safe = np.where(upright, 1.0, length)
    ratio = np.where(upright, 1.0, np.arctan2(length, mast[..., 2]) / safe)
    lengthening = np.where(upright, 0.0, (mast[..., :2] * change[..., :2]).sum(axis=-1) / safe)
    turning = mast[..., 2] * lengthening - length * change[..., 2]
    stretching = (turning - ratio * lengthening) / safe
    x, y = (change[..., i] * ratio + mast[..., i] * stretching for i in range(2))
    return np.stack([-y, x], axis=-1)


def _balance_axis_of(states: npt.NDArray[np.float64], com: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Vectors along the line from the ball's center to the CoM, inertial frame."""
    com = np.asarray(com, dtype=np.float64)
    if not com[..., :2].any():
        return mast_of(states)
    axis: npt.NDArray[np.float64] = np.einsum("...ij,...j->...i", body_axes_of(states), com)
    return axis
