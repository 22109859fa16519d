"""A plane that follows the ground under a ball: uneven ground for engines that only collide with planes."""

import numpy as np

from ballbot_rs._core import Terrain
from ballbot_rs.engines.robot_geometry import Array

#: Fixed-point steps to the contact point, and their tolerance, m. Each step at least halves the distance: valleys
#: have at most half of the ball's curvature.
_MOST_STEPS = 60
_FOUND = 1e-12
#: Distance from the origin beyond which a state has diverged, m.
_FARTHEST = 1e6


def contact_plane(terrain: Terrain, center: Array, radius: float) -> tuple[Array, Array]:
    """The plane tangent to the ground at the point where a ball with this center touches it, or would.

    Args:
        terrain: the ground.
        center: of the ball, shape (3,), m.
        radius: of the ball, m.

    Returns:
        A point of the plane, shape (3,), m, and its smallest rotation from horizontal, as (w, x, y, z).
    """
    if not np.abs(center).max() < _FARTHEST:
        # A state that has diverged has no such point.
        return np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    place = center[:2]
    normal = terrain.normal(*place)
    for _ in range(_MOST_STEPS):
        before, place = place, center[:2] - normal[:2] * radius
        normal = terrain.normal(*place)
        if np.abs(place - before).max() <= _FOUND:
            break
    quaternion = np.array([1.0 + normal[2], -normal[1], normal[0], 0.0])
    return np.append(place, terrain.height(*place)), quaternion / np.linalg.norm(quaternion)
