"""Triangles of the obstacles of a terrain."""

from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from ballbot_rs._core import Terrain

FloatArray = npt.NDArray[np.float64]

#: Length, thickness and height of the part of a wall that is shown, m.
WALL: Final = (40.0, 0.1, 0.6)

#: Depth to which obstacles are shown below the ground at their place, m.
BURIED: Final = 0.5

#: Sides of a post.
SIDES: Final = 24


def obstacle_mesh(terrain: Terrain) -> tuple[FloatArray, npt.NDArray[np.uint32]] | None:
    """Vertices (n, 3), m, and faces (m, 3) of all obstacles; None without obstacles."""
    shapes = [_mesh(terrain, obstacle) for obstacle in terrain.obstacles]
    if not shapes:
        return None
    whole = trimesh.util.concatenate(shapes)
    return np.asarray(whole.vertices, dtype=np.float64), np.asarray(whole.faces, dtype=np.uint32)


def _mesh(terrain: Terrain, obstacle: dict[str, object]) -> trimesh.Trimesh:
    numbers = {name: float(str(value)) for name, value in obstacle.items() if name != "kind"}
    x, y, yaw = numbers["x"], numbers["y"], numbers.get("yaw", 0.0)
    length, thickness, height = WALL
    if obstacle["kind"] == "post":
        height = numbers["height"]
        mesh = trimesh.creation.cylinder(numbers["radius"], height + BURIED, sections=SIDES)
    elif obstacle["kind"] == "box":
        height = numbers["height"]
        mesh = trimesh.creation.box((numbers["length"], numbers["width"], height + BURIED))
    else:
        mesh = trimesh.creation.box((thickness, length, height + BURIED))
        mesh.apply_translation((-0.5 * thickness, 0.0, 0.0))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(yaw, (0.0, 0.0, 1.0)))
    mesh.apply_translation((x, y, float(np.asarray(terrain.height(x, y))) + 0.5 * (height - BURIED)))
    return mesh
