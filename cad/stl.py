"""Binary, closed STL files in meters: neighboring triangles share corners to the last bit."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from OCP.BRepMesh import BRepMesh_IncrementalMesh

from cad.part import Part

_HEADER = b"ballbot, metres"


def triangles_of(part: Part, tolerance: float, angle: float) -> np.ndarray:
    """Triangles of a part, shape (n, 3, 3), m, without triangles of zero area."""
    # By default CadQuery interprets the tolerance relative to each edge.
    BRepMesh_IncrementalMesh(part.solid.wrapped, tolerance, False, angle)
    corners, faces = part.solid.tessellate(tolerance, angle)
    # Faces are tessellated separately, so corners of a common edge differ by rounding.
    points = np.round([corner.toTuple() for corner in corners], 3) * 1e-3
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    index = first[inverse.ravel()][np.array(faces)]
    a, b, c = index.T
    triangles: npt.NDArray[np.float64] = points[index[(a != b) & (b != c) & (c != a)]]
    return triangles


def write(path: Path, parts: list[Part], tolerance: float, angle: float) -> int:
    """Writes all parts into one file; returns the number of triangles."""
    triangles = np.concatenate([triangles_of(part, tolerance, angle) for part in parts])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["normal"], rows["corners"] = normals, triangles
    path.write_bytes(_HEADER.ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return len(rows)
