"""The camera of a client: its pose, and the ray of a point on its screen."""

import math

import numpy as np
import numpy.typing as npt
import viser

#: Vertical field of view, rad: a wide view makes upright robots at the side look tilted.
FOV = math.radians(38.0)

#: Direction from the robots to the camera.
DIRECTION = np.array([-0.60, -0.76, 0.36]) / np.linalg.norm([-0.60, -0.76, 0.36])

#: Fraction of the picture that stays free around the robots.
MARGIN = 1.4


def screen_ray(wxyz: npt.ArrayLike, fov: float, aspect: float, screen: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Direction of a point on the screen, shape (3,).

    Args:
        wxyz: attitude of the camera, which looks along z, with x to the right and y down.
        fov: vertical field of view, rad.
        aspect: width over height.
        screen: from (0, 0), top left, to (1, 1).
    """
    half = math.tan(0.5 * fov)
    ray = np.array([(2.0 * screen[0] - 1.0) * aspect * half, (2.0 * screen[1] - 1.0) * half, 1.0])
    return np.asarray(viser.transforms.SO3(np.asarray(wxyz, dtype=np.float64)).apply(ray), dtype=np.float64)


def distance_for(radius: float, fov: float, aspect: float) -> float:
    """Distance from which a sphere of a radius, m, fills a picture except for a margin."""
    narrow = min(fov, 2.0 * math.atan(math.tan(0.5 * fov) * aspect))
    return MARGIN * radius / math.sin(0.5 * narrow)


def frame_robots(client: viser.ClientHandle, reach: float, height: float) -> None:
    """Places the camera of a client so that it sees robots of a height, m, within a distance from the middle, m."""
    middle = np.array([0.0, 0.0, 0.5 * height])
    aspect = client.camera.aspect
    distance = distance_for(math.hypot(reach, 0.5 * height), FOV, aspect)
    with client.atomic():
        client.camera.fov = FOV
        # The look-at point moves along with the camera, so it comes last.
        client.camera.position = tuple(middle + distance * DIRECTION)
        client.camera.look_at = tuple(middle)
