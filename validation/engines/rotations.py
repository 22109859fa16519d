"""Rotations as quaternions [w, x, y, z], matrices and angles; first array axes over robots."""

import numpy as np

from ballbot_rs.engines.robot_geometry import Array


def matrix(quaternion: Array) -> Array:
    """Rotation matrix (3×3) of one unit quaternion (4)."""
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def product(a: Array, b: Array) -> Array:
    """Product of two quaternions (4): the rotation by b, then by a."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def attitude(tilt: Array, yaw: Array) -> Array:
    """Quaternions (n, 4) of bodies rotated by `yaw` (n), then tilted by rotation vectors `tilt` (n, 2), rad."""
    angle = np.hypot(tilt[:, 0], tilt[:, 1])
    share = 0.5 * np.sinc(angle / (2.0 * np.pi))
    w, x, y = np.cos(0.5 * angle), tilt[:, 0] * share, tilt[:, 1] * share
    cos, sin = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    return np.stack([w * cos, x * cos + y * sin, y * cos - x * sin, w * sin], axis=1)


def to_body(quaternions: Array, vectors: Array) -> Array:
    """Vectors (n, 3) of the inertial frame in the frames of bodies with attitudes (n, 4)."""
    w, v = quaternions[:, :1], -quaternions[:, 1:]
    twice = 2.0 * np.cross(v, vectors)
    return np.asarray(vectors + w * twice + np.cross(v, twice))


def roll_pitch_yaw(axes: Array) -> tuple[float, float, float]:
    """Angles of a URDF for a rotation matrix (3×3), rad."""
    pitch = float(np.arctan2(-axes[2, 0], np.hypot(axes[2, 1], axes[2, 2])))
    return float(np.arctan2(axes[2, 1], axes[2, 2])), pitch, float(np.arctan2(axes[1, 0], axes[0, 0]))
