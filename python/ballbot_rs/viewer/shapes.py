"""The look of a robot: colored triangles for the ball, the body and each wheel, in their own frames."""

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import trimesh

from ballbot_rs._core import Params

FloatArray = npt.NDArray[np.float64]
Color = tuple[int, int, int]

BALL_COLORS: tuple[Color, Color] = ((204, 56, 46), (236, 200, 190))
TYRE: Color = (26, 76, 140)
HUB: Color = (240, 140, 26)
PLATE: Color = (72, 78, 90)
MAST: Color = (170, 176, 184)


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
    sphere = trimesh.creation.uv_sphere(radius=radius, count=[33, 33])
    side = np.sign(np.asarray(sphere.triangles_center)).prod(axis=1) > 0
    vertices, faces = np.asarray(sphere.vertices), np.asarray(sphere.faces)
    return [Piece(vertices, faces[side], BALL_COLORS[0]), Piece(vertices, faces[~side], BALL_COLORS[1])]


def from_params(params: Params) -> Look:
    """A robot made only from its parameters; they have no outlines, so its inertia determines its height."""
    reach = params.ball_radius + params.wheel_radius
    width = reach * math.sin(max(params.wheel_zeniths))
    deck = reach * math.cos(min(params.wheel_zeniths)) + params.wheel_radius
    top = max(params.body_com_height + params.slender_half_length, deck + params.wheel_radius)
    body = [
        _cylinder(width, deck, deck + 0.02, PLATE),
        _cylinder(0.25 * width, deck, top, MAST),
        _cylinder(0.8 * width, 0.5 * (deck + top), 0.5 * (deck + top) + 0.02, PLATE),
        _cylinder(0.6 * width, top - 0.02, top, HUB),
    ]
    places = zip(params.wheel_zeniths, params.wheel_azimuths, strict=True)
    return Look(
        ball_of(params.ball_radius), by_color(body), [_wheel(params, zenith, azimuth) for zenith, azimuth in places]
    )


def wheel_heights(params: Params) -> list[float]:
    """Height of each wheel center in the body frame, m."""
    return [(params.ball_radius + params.wheel_radius) * math.cos(zenith) for zenith in params.wheel_zeniths]


def _wheel(params: Params, zenith: float, azimuth: float) -> Wheel:
    radius, half_width = params.wheel_radius, 0.24 * params.wheel_radius
    spoke = np.array([1.6 * radius, 0.2 * radius, 2.2 * half_width])
    pieces = [
        _cylinder(radius, -half_width, half_width, TYRE),
        _cylinder(0.35 * radius, -1.3 * half_width, 1.3 * half_width, MAST),
        piece(trimesh.creation.box(spoke), HUB),
    ]
    sin_zenith, cos_zenith = math.sin(zenith), math.cos(zenith)
    sin_azimuth, cos_azimuth = math.sin(azimuth), math.cos(azimuth)
    outwards = np.array([sin_zenith * cos_azimuth, sin_zenith * sin_azimuth, cos_zenith])
    drive = np.array([-sin_azimuth, cos_azimuth, 0.0])
    mount = np.eye(4)
    mount[:3, :3] = np.stack([-outwards, drive, np.cross(-outwards, drive)], axis=1)
    mount[:3, 3] = (params.ball_radius + params.wheel_radius) * outwards
    return Wheel(pieces, mount, np.array([0.0, 0.0, 1.0]))


def _cylinder(radius: float, bottom: float, top: float, color: Color) -> Piece:
    origin = np.eye(4)
    origin[2, 3] = 0.5 * (bottom + top)
    return piece(trimesh.creation.cylinder(radius=radius, height=top - bottom, sections=32), color, origin)
