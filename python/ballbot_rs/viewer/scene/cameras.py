"""What the camera follows, rays through the picture, and views of all robots."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs.viewer.scene.heading import heading_of

FloatArray = npt.NDArray[np.float64]

#: Vertical field of view, rad: a wide view makes upright robots at the side look tilted.
FOV = math.radians(38.0)

#: Direction from the robots to the camera.
DIRECTION = np.array([-0.60, -0.76, 0.36]) / np.linalg.norm([-0.60, -0.76, 0.36])

#: The same behind a robot that is driven.
BEHIND = np.array([-0.90, 0.0, 0.44]) / np.linalg.norm([-0.90, 0.0, 0.44])

#: Fraction of the picture that stays free around the robots.
MARGIN = 1.4

#: What the camera follows, by label.
FREE, FOLLOW, CHASE = "stays", "follows robot 0", "chases robot 0"
CAMERAS: Final = (FOLLOW, CHASE, FREE)

#: Fraction of the difference to the heading by which a chasing camera turns in a frame: it smooths quick turns.
TURN: Final = 0.15


class Camera:
    """The world's pose in the scene: the world moves, and cameras stay where the user puts them."""

    def __init__(self) -> None:
        #: One of `CAMERAS`.
        self.kind = FOLLOW
        #: The point of the ground in the middle of the scene, m, and the angle by which the camera is turned, rad.
        self.middle = np.zeros(3)
        self.turn = 0.0

    def follow(self, middle: FloatArray, state: FloatArray) -> bool:
        """Puts a point in the middle, turned with the heading of a state if it chases; whether anything changed."""
        turn = 0.0
        if self.kind == CHASE:
            difference = math.remainder(heading_of(state) - self.turn, 2.0 * math.pi)
            turn = self.turn + TURN * difference
        if turn == self.turn and np.array_equal(middle, self.middle):
            return False
        self.middle, self.turn = middle.copy(), turn
        return True

    @property
    def rotation(self) -> FloatArray:
        """From the scene to the world, (3, 3)."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def point(self, place: npt.ArrayLike) -> FloatArray:
        """A point of the scene in the world, m."""
        found: FloatArray = self.rotation @ np.asarray(place, dtype=np.float64) + self.middle
        return found

    def vector(self, direction: npt.ArrayLike) -> FloatArray:
        """A direction of the scene in the world."""
        found: FloatArray = self.rotation @ np.asarray(direction, dtype=np.float64)
        return found


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


def frame_robots(client: viser.ClientHandle, reach: float, height: float, *, behind: bool) -> None:
    """Places the camera of a client so that it sees robots of a height, m, within a distance from the middle, m."""
    with client.atomic():
        place_camera(client.camera, client.camera.aspect, reach, height, behind=behind)


def place_camera(
    camera: viser.CameraHandle | viser.InitialCameraConfig, aspect: float, reach: float, height: float, *, behind: bool
) -> None:
    """As `frame_robots`, in a picture of a width over height."""
    middle = np.array([0.0, 0.0, 0.5 * height])
    distance = distance_for(math.hypot(reach, 0.5 * height), FOV, aspect)
    camera.fov = FOV
    # The look-at point moves along with the camera, so it comes last.
    camera.position = tuple(middle + distance * (BEHIND if behind else DIRECTION))
    camera.look_at = tuple(middle)
