"""The ground: a level floor or a patch of uneven ground around robot 0, obstacles; its intersections with rays."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._core import Terrain
from ballbot_rs.viewer.scene.cameras import Camera
from ballbot_rs.viewer.scene.heading import about_z
from ballbot_rs.viewer.scene.look import Color
from ballbot_rs.viewer.scene.obstacles import obstacle_mesh

FloatArray = npt.NDArray[np.float64]

#: Size of the level floor and of its squares, m, and darkness of shadows on it.
FLOOR_SIZE, SECTION, SHADOW = 20.0, 1.0, 0.3


@dataclasses.dataclass(frozen=True)
class Colors:
    """Colors of the ground."""

    plane: Color
    cell: Color
    section: Color
    terrain: Color
    lines: Color


LIGHT = Colors((246, 248, 250), (214, 219, 226), (172, 180, 190), (214, 220, 227), (150, 160, 172))
DARK = Colors((31, 36, 43), (48, 55, 64), (78, 87, 99), (62, 70, 80), (104, 114, 126))

#: Color of obstacles.
OBSTACLES = (197, 138, 92)

#: Half the patch's edge, the spacing of its corners and of its lines, and how far the robot gets from its middle, m.
HALF, CELL, LINES, AWAY = 4.0, 0.05, 0.5, 1.5

#: Height of lines above the ground, m.
LIFT = 0.003

_COUNT = round(2.0 * HALF / CELL) + 1
_EVERY = round(LINES / CELL)

#: Sample distances along a ray, m: in steps smaller than a ball, and geometric farther away.
WAYS = np.concatenate([np.arange(0.0, 10.0, 0.02), np.geomspace(10.0, 1000.0, 2304)])


class Ground:
    """The level floor or the patch; `clicked` is called with a click on it."""

    def __init__(
        self, server: viser.ViserServer, name: str, clicked: Callable[[viser.SceneNodePointerEvent[Any]], None]
    ) -> None:
        self._grid = server.scene.add_grid(
            "/floor",
            width=FLOOR_SIZE,
            height=FLOOR_SIZE,
            cell_size=0.1,
            cell_color=LIGHT.cell,
            section_color=LIGHT.section,
            section_size=SECTION,
            plane_color=LIGHT.plane,
            plane_opacity=1.0,
            shadow_opacity=SHADOW,
            fade_distance=FLOOR_SIZE,
        )
        # Clicks go to a sheet under the grid: viser distinguishes clicks on a node from drags, which turn the camera.
        half = 0.5 * FLOOR_SIZE
        corners = np.array([(-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)])
        self._floor = server.scene.add_mesh_simple(
            "/sheet", corners, np.array([(0, 1, 2), (0, 2, 3)]), opacity=0.01, position=(0.0, 0.0, -0.002)
        )
        self._floor.on_click(clicked)
        flat = np.zeros((_COUNT * _COUNT, 3), dtype=np.float32)
        self._patch = server.scene.add_mesh_simple(
            f"{name}/sheet", flat, _faces(), color=LIGHT.terrain, flat_shading=False, visible=False, cast_shadow=False
        )
        self._patch.on_click(clicked)
        self._lines = server.scene.add_line_segments(
            f"{name}/lines", np.zeros((1, 2, 3)), LIGHT.lines, thickness=0.004, visible=False
        )
        self._server, self._name = server, name
        self._obstacles: viser.MeshHandle | None = None
        #: The ground shown; None is level.
        self.terrain: Terrain | None = None
        self._middle = np.zeros(2)

    def show(self, terrain: Terrain | None, around: FloatArray) -> None:
        """Shows the ground around a point (x, y), m."""
        is_new = terrain is not self.terrain
        self.terrain = terrain
        if is_new:
            self._grid.visible = self._floor.visible = terrain is None
            self._patch.visible = self._lines.visible = terrain is not None
            self._show_obstacles(terrain)
        if terrain is None or (not is_new and np.abs(around - self._middle).max() < AWAY):
            return
        # Lines do not move when the patch moves.
        self._middle = np.round(around / LINES) * LINES
        points = patch(terrain, self._middle)
        self._patch.vertices = np.float32(points.reshape(-1, 3))
        self._lines.points = np.float32(_lines(points))

    def _show_obstacles(self, terrain: Terrain | None) -> None:
        if self._obstacles is not None:
            self._obstacles.remove()
        mesh = None if terrain is None else obstacle_mesh(terrain)
        self._obstacles = mesh and self._server.scene.add_mesh_simple(
            f"{self._name}/obstacles", np.float32(mesh[0]), mesh[1], color=OBSTACLES
        )

    def set_dark(self, is_dark: bool) -> None:
        """Shows it in light or dark colors."""
        colors = DARK if is_dark else LIGHT
        self._grid.plane_color, self._grid.cell_color, self._grid.section_color = (
            colors.plane,
            colors.cell,
            colors.section,
        )
        self._patch.color = colors.terrain
        self._lines.colors = np.array(colors.lines, dtype=np.uint8)

    def move_floor(self, camera: Camera) -> None:
        """Moves the level floor below a camera."""
        # The grid repeats after a section, so that it seems endless.
        rest = np.fmod(camera.middle, SECTION) * (1.0, 1.0, 0.0)
        self._grid.position = -camera.rotation.T @ rest
        self._grid.wxyz = about_z(-camera.turn)


def patch(terrain: Terrain, middle: FloatArray) -> FloatArray:
    """Points of the ground around a point, m, shape (n, n, 3), rows along y."""
    steps = np.linspace(-HALF, HALF, _COUNT)
    x, y = np.meshgrid(middle[0] + steps, middle[1] + steps)
    return np.stack([x, y, np.asarray(terrain.height(x, y))], axis=-1)


def _faces() -> npt.NDArray[np.uint32]:
    corners = np.arange(_COUNT * _COUNT, dtype=np.uint32).reshape(_COUNT, _COUNT)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def _lines(points: FloatArray) -> FloatArray:
    """Segments of the lines along x and along y, shape (n, 2, 3)."""
    lifted = points + np.array([0.0, 0.0, LIFT])
    segments = [
        np.stack([line[:, :-1], line[:, 1:]], axis=2).reshape(-1, 2, 3)
        for line in (lifted[::_EVERY], lifted.transpose(1, 0, 2)[::_EVERY])
    ]
    return np.concatenate(segments)


def ray_meets(
    terrain: Terrain | None, origin: npt.NDArray[np.float64], direction: npt.NDArray[np.float64]
) -> tuple[float, float] | None:
    """The first intersection (x, y) of a ray with the ground, m; None if there is none."""
    if terrain is None:
        if origin[2] <= 0.0 or direction[2] > -1e-6:
            return None
        x, y, _ = origin - origin[2] / direction[2] * direction
        return float(x), float(y)
    points = origin + WAYS[:, np.newaxis] * direction / np.linalg.norm(direction)
    gaps = points[:, 2] - np.asarray(terrain.height(points[:, 0], points[:, 1]))
    below = np.flatnonzero(gaps < 0.0)
    if not len(below) or below[0] == 0:
        return None
    last, first = below[0] - 1, below[0]
    share = gaps[last] / (gaps[last] - gaps[first])
    x, y, _ = points[last] + share * (points[first] - points[last])
    return float(x), float(y)
