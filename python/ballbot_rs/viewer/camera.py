"""The camera of a client: where it is put, and the ray of a place of its screen."""

import math

import numpy as np
import numpy.typing as npt
import viser

#: Vertical angle of view, rad: a wide one makes upright robots at the side look tilted.
FOV = math.radians(38.0)

#: Where the camera is from the robots, as a direction.
DIRECTION = np.array([-0.60, -0.76, 0.36]) / np.linalg.norm([-0.60, -0.76, 0.36])

#: Share of the picture that stays free around the robots.
MARGIN = 1.4


def screen_ray(wxyz: npt.ArrayLike, fov: float, aspect: float, screen: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Direction of what is at a place of the screen, shape (3,).

    Args:
        wxyz: attitude of the camera, which looks along z, with x to the right and y down.
        fov: vertical angle of view, rad.
        aspect: width over height.
        screen: from (0, 0), top left, to (1, 1).
    """
    half = math.tan(0.5 * fov)
    ray = np.array([(2.0 * screen[0] - 1.0) * aspect * half, (2.0 * screen[1] - 1.0) * half, 1.0])
    return np.asarray(viser.transforms.SO3(np.asarray(wxyz, dtype=np.float64)).apply(ray), dtype=np.float64)


def distance_for(radius: float, fov: float, aspect: float) -> float:
    """From where a ball of a radius, m, fills a picture, but for a margin."""
    narrow = min(fov, 2.0 * math.atan(math.tan(0.5 * fov) * aspect))
    return MARGIN * radius / math.sin(0.5 * narrow)


def frame_robots(client: viser.ClientHandle, reach: float, height: float) -> None:
    """Puts the camera of a client where it sees robots of a height, m, within a distance from the middle, m."""
    middle = np.array([0.0, 0.0, 0.5 * height])
    aspect = client.camera.aspect
    distance = distance_for(math.hypot(reach, 0.5 * height), FOV, aspect)
    with client.atomic():
        client.camera.fov = FOV
        # What is looked at moves along with the camera, so it comes last.
        client.camera.position = tuple(middle + distance * DIRECTION)
        client.camera.look_at = tuple(middle)
