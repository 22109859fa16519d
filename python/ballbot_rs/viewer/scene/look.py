"""What a robot looks like: colored triangles for ball, body and wheels."""

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import trimesh

from ballbot_rs._core import Params
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.media.shapes import COLORS, Shape, body_of, wheel_of

FloatArray = npt.NDArray[np.float64]
Color = tuple[int, int, int]

BALL_COLORS: tuple[Color, Color] = ((204, 56, 46), (236, 200, 190))

#: Cells along the edge of an octant of the ball.
OCTANT = 16


@dataclasses.dataclass(frozen=True)
class Piece:
    """Triangles of one color."""

    vertices: FloatArray
    faces: npt.NDArray[np.int64]
    color: Color


@dataclasses.dataclass(frozen=True)
class Wheel:
    """A wheel in its own frame, and the 4×4 pose of that frame in the body frame at wheel angle zero."""

    pieces: list[Piece]
    mount: FloatArray
    #: Axis of the wheel angle in the wheel's frame.
    axle: FloatArray


@dataclasses.dataclass(frozen=True)
class Look:
    """A robot; the body's frame is at the ball center, z along the mast."""

    ball: list[Piece]
    body: list[Piece]
    wheels: list[Wheel]


def piece(mesh: trimesh.Trimesh, color: Color, origin: npt.ArrayLike | None = None) -> Piece:
    """A mesh as a piece, moved by a 4×4 matrix."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if origin is not None:
        matrix = np.asarray(origin, dtype=np.float64)
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Piece(vertices, np.asarray(mesh.faces, dtype=np.int64), color)


def by_color(pieces: list[Piece]) -> list[Piece]:
    """The same with one piece per color, which is faster to draw."""
    merged = []
    for color in dict.fromkeys(one.color for one in pieces):
        same = [one for one in pieces if one.color == color]
        starts = np.cumsum([0, *(len(one.vertices) for one in same)])
        merged.append(
            Piece(
                np.concatenate([one.vertices for one in same]),
                np.concatenate([one.faces + start for one, start in zip(same, starts[:-1], strict=True)]),
                color,
            )
        )
    return merged


def ball_of(radius: float) -> list[Piece]:
    """A sphere whose octants alternate between two colors, so that rolling is visible."""
    # The borders of the colors are edges of the triangles.
    x, z = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0.0, 0.5 * math.pi, OCTANT + 1)] * 2, indexing="ij"))
    octant = radius * np.stack([np.cos(x) * np.sin(z), np.sin(x) * np.sin(z), np.cos(z)], axis=1)
    corners = np.arange((OCTANT + 1) ** 2).reshape(OCTANT + 1, OCTANT + 1)
    a, b, c, d = (one.ravel() for one in (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]))
    outwards = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    pieces = []
    for signs in np.array(np.meshgrid(*[[1.0, -1.0]] * 3)).reshape(3, -1).T:
        faces = outwards if signs.prod() > 0.0 else outwards[:, ::-1]
        pieces.append(Piece(octant * signs, faces, BALL_COLORS[0 if signs.prod() > 0.0 else 1]))
    return by_color(pieces)


def from_params(params: Params) -> Look:
    """The robot as `media.shapes` has it."""
    robot = robot_geometry(params)
    body, wheel = (
        by_color([_of_shape(one) for one in shapes]) for shapes in (body_of(robot), wheel_of(params.wheel_radius))
    )
    mounts = np.tile(np.eye(4), (3, 1, 1))
    mounts[:, :3, :3] = np.stack([-robot.contacts, robot.rims, robot.axles], axis=2)
    mounts[:, :3, 3] = robot.centers
    return Look(ball_of(params.ball_radius), body, [Wheel(wheel, mount, np.array([0.0, 0.0, 1.0])) for mount in mounts])


def _of_shape(shape: Shape) -> Piece:
    if shape.kind == "box":
        mesh = trimesh.creation.box(shape.size)
    elif shape.kind == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=shape.size[0])
    else:
        mesh = trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=32)
    return piece(mesh, COLORS[shape.color], shape.pose)
