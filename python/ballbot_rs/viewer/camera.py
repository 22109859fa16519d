"""The camera of a client: where it is put, and what of the floor is at a place of its screen."""

import math

import numpy as np
import numpy.typing as npt
import viser


def floor_point(
    position: npt.ArrayLike, wxyz: npt.ArrayLike, fov: float, aspect: float, screen: tuple[float, float]
) -> tuple[float, float] | None:
    """The point of the floor (x, y), m, at a place of the screen; None above the horizon.

    Args:
        position: of the camera, m.
        wxyz: attitude of the camera, which looks along z, with x to the right and y down.
        fov: vertical angle of view, rad.
        aspect: width over height.
        screen: from (0, 0), top left, to (1, 1).
    """
    half = math.tan(0.5 * fov)
    ray = np.array([(2.0 * screen[0] - 1.0) * aspect * half, (2.0 * screen[1] - 1.0) * half, 1.0])
    dx, dy, dz = viser.transforms.SO3(np.asarray(wxyz, dtype=np.float64)).apply(ray)
    x, y, z = np.asarray(position, dtype=np.float64)
    if z <= 0.0 or dz > -1e-6:
        return None
    return float(x - z / dz * dx), float(y - z / dz * dy)


def look_from(client: viser.ClientHandle, distance: float) -> None:
    """Puts the camera of a client at a distance from the robot, m."""
    client.camera.position = (-0.8 * distance, -distance, 0.55 * distance + 0.3)
    client.camera.look_at = (0.0, 0.0, 0.2)
