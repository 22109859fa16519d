"""Unit quaternions (w, x, y, z), shape (..., 4)."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def conjugate(q: Array) -> Array:
    """The inverse of a unit quaternion (w, x, y, z)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def about_vertical(angle: Array) -> Array:
    """The quaternion of a rotation about z, shape (..., 4)."""
    zero = np.zeros_like(angle)
    return np.stack([np.cos(0.5 * angle), zero, zero, np.sin(0.5 * angle)], axis=-1)


def to_vertical(direction: Array) -> Array:
    """The shortest rotation of a direction above the horizontal plane, shape (3,), to the vertical."""
    x, y, z = direction / np.linalg.norm(direction)
    quaternion = np.array([1.0 + z, y, -x, 0.0])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def product(a: Array, b: Array) -> Array:
    """The quaternion product a b."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def rotation_vector(q: Array) -> Array:
    """The rotation vector of a unit quaternion, at most π long."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    # 2 for small angles.
    return np.asarray(q[..., 1:] * np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 2.0))
