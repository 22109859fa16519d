"""A robot in the scene: colored triangles for ball, body and wheels, from its URDFs or its parameters."""

import dataclasses
import functools
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
import viser
import yourdfpy

from ballbot_rs import _assets
from ballbot_rs._core import Params
from ballbot_rs._reading import read_regular
from ballbot_rs._state_rows import (
    BALL_POSITION,
    BALL_QUATERNION,
    BODY_POSITION,
    BODY_QUATERNION,
    WHEEL_ANGLES,
)

FloatArray = npt.NDArray[np.float64]
Color = tuple[int, int, int]

BALL_COLORS: tuple[Color, Color] = ((204, 56, 46), (236, 200, 190))
TYRE: Color = (26, 76, 140)
HUB: Color = (240, 140, 26)
PLATE: Color = (72, 78, 90)
MAST: Color = (170, 176, 184)

#: Largest URDF and largest mesh file, bytes, and most triangles of a mesh: the limits of the core.
MAX_URDF = 16 << 20
MAX_MESH = 128 << 20
MAX_TRIANGLES = 2_000_000

#: The robots that have URDFs.
URDFS = {"paper": (_assets.path("bot.urdf"), _assets.path("ball.urdf"))}


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
    wheels = [_wheel(params, outwards, drive) for outwards, drive in zip(*contact_directions(params), strict=True)]
    return Look(ball_of(params.ball_radius), by_color(body), wheels)


def wheel_heights(params: Params) -> list[float]:
    """Height of each wheel center in the body frame, m."""
    return [(params.ball_radius + params.wheel_radius) * math.cos(zenith) for zenith in params.wheel_zeniths]


def contact_directions(params: Params) -> tuple[FloatArray, FloatArray]:
    """Directions from the ball's center to each wheel, and drive directions, body frame, shape (3, 3)."""
    zeniths, azimuths = np.asarray(params.wheel_zeniths), np.asarray(params.wheel_azimuths)
    sin, cos = np.sin(zeniths), np.cos(zeniths)
    outwards = np.stack([sin * np.cos(azimuths), sin * np.sin(azimuths), cos], axis=1)
    drives = np.stack([-np.sin(azimuths), np.cos(azimuths), np.zeros(3)], axis=1)
    return outwards, drives


def _wheel(params: Params, outwards: FloatArray, drive: FloatArray) -> Wheel:
    radius, half_width = params.wheel_radius, 0.24 * params.wheel_radius
    spoke = np.array([1.6 * radius, 0.2 * radius, 2.2 * half_width])
    pieces = [
        _cylinder(radius, -half_width, half_width, TYRE),
        _cylinder(0.35 * radius, -1.3 * half_width, 1.3 * half_width, MAST),
        piece(trimesh.creation.box(spoke), HUB),
    ]
    mount = np.eye(4)
    mount[:3, :3] = np.stack([-outwards, drive, np.cross(-outwards, drive)], axis=1)
    mount[:3, 3] = (params.ball_radius + params.wheel_radius) * outwards
    return Wheel(pieces, mount, np.array([0.0, 0.0, 1.0]))


def _cylinder(radius: float, bottom: float, top: float, color: Color) -> Piece:
    origin = np.eye(4)
    origin[2, 3] = 0.5 * (bottom + top)
    return piece(trimesh.creation.cylinder(radius=radius, height=top - bottom, sections=32), color, origin)


def from_urdf(params: Params, bot_path: Path, ball_path: Path) -> Look:
    """The visual shapes of a ballbot described by two URDFs.

    Raises:
        ValueError: wheels and body cannot be distinguished, or a file is not a regular file, too large or malformed.
        OSError: a file cannot be read.
    """
    bot, ball = _load(bot_path), _load(ball_path)
    wheels = [joint for joint in bot.robot.joints if joint.type in ("continuous", "revolute")]
    if len(wheels) != 3:
        raise ValueError(f"{bot_path} has {len(wheels)} wheel joints: expected 3")
    pieces: dict[str, list[Piece]] = {joint.child: [] for joint in wheels}
    body: list[Piece] = []
    for link in bot.robot.links:
        owner = _carrier(bot, link.name, set(pieces))
        within = bot.get_transform(link.name, owner)
        pieces.get(owner, body).extend(_pieces(bot, link, within))
    # The root frame may be at any height on the mast; ours is at the ball center.
    mounts = [np.asarray(bot.get_transform(joint.child)) for joint in wheels]
    lift = np.eye(4)
    lift[2, 3] = wheel_heights(params)[0] - mounts[0][2, 3]
    body = [Piece(one.vertices + lift[:3, 3], one.faces, one.color) for one in body]
    return Look(
        _ball(ball, params),
        by_color(body),
        [
            Wheel(by_color(pieces[joint.child]), lift @ mount, np.asarray(joint.axis, dtype=np.float64))
            for joint, mount in zip(wheels, mounts, strict=True)
        ],
    )


def _load(path: Path) -> yourdfpy.URDF:
    text = io.BytesIO(read_regular(path, MAX_URDF))
    meshes = functools.partial(yourdfpy.filename_handler_magic, dir=str(path.parent))
    try:
        return yourdfpy.URDF.load(text, build_scene_graph=True, load_meshes=False, filename_handler=meshes)
    # In addition to its own errors it passes on errors of the XML parser.
    except Exception as error:
        raise ValueError(f"{path}: {error}") from error


def _ball(ball: yourdfpy.URDF, params: Params) -> list[Piece]:
    """The ball's pieces; a plain sphere gets a pattern that makes rolling visible."""
    shapes = [visual.geometry for link in ball.robot.links for visual in link.visuals]
    if all(shape is None or shape.mesh is None for shape in shapes):
        return ball_of(params.ball_radius)
    return by_color([one for link in ball.robot.links for one in _pieces(ball, link, np.eye(4))])


def _carrier(bot: yourdfpy.URDF, link: str, wheels: set[str]) -> str:
    """The wheel that a link is fixed to, else the root."""
    parents = {joint.child: joint.parent for joint in bot.robot.joints}
    while link not in wheels and link in parents:
        link = parents[link]
    return link


def _pieces(robot: yourdfpy.URDF, link: yourdfpy.Link, within: npt.ArrayLike) -> list[Piece]:
    pieces = []
    for visual in link.visuals:
        mesh = _mesh(robot, visual.geometry)
        if mesh is not None:
            origin = np.eye(4) if visual.origin is None else np.asarray(visual.origin)
            pieces.append(piece(mesh, _color(robot, visual.material), np.asarray(within) @ origin))
    return pieces


def _mesh(robot: yourdfpy.URDF, shape: yourdfpy.Geometry | None) -> trimesh.Trimesh | None:
    mesh: trimesh.Trimesh | None = None
    if shape is None:
        return None
    if shape.sphere is not None:
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.sphere.radius)
    elif shape.cylinder is not None:
        mesh = trimesh.creation.cylinder(radius=shape.cylinder.radius, height=shape.cylinder.length, sections=32)
    elif shape.box is not None:
        mesh = trimesh.creation.box(shape.box.size)
    elif shape.mesh is not None:
        mesh = _read_mesh(Path(robot._filename_handler(fname=shape.mesh.filename)))
        mesh.vertices = np.asarray(mesh.vertices) * (1.0 if shape.mesh.scale is None else shape.mesh.scale)
    return mesh


def _read_mesh(path: Path) -> trimesh.Trimesh:
    """The triangles of a file. No other file is opened, such as materials, which the page does not show."""
    contents = io.BytesIO(read_regular(path, MAX_MESH))
    try:
        mesh = trimesh.load_mesh(contents, file_type=path.suffix.lower().lstrip("."))
    # Its readers may raise anything for a malformed file.
    except Exception as error:
        raise ValueError(f"{path} is not a readable mesh: {error or type(error).__name__}") from error
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ValueError(f"{path} has no triangles")
    if len(mesh.faces) > MAX_TRIANGLES:
        raise ValueError(f"{path} has {len(mesh.faces)} triangles, limit {MAX_TRIANGLES}")
    if not np.isfinite(mesh.vertices).all():
        raise ValueError(f"{path} has a corner that is not finite")
    return mesh


def _color(robot: yourdfpy.URDF, material: yourdfpy.Material | None) -> Color:
    if material is not None and material.color is None:
        material = next((known for known in robot.robot.materials if known.name == material.name), None)
    if material is None or material.color is None:
        return TYRE
    red, green, blue = (round(255.0 * float(part)) for part in material.color.rgba[:3])
    return red, green, blue


class RobotNodes:
    """The scene nodes of one robot."""

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        look: Look,
        place: tuple[float, float, float],
        opacity: float | None = None,
    ) -> None:
        self._scene, self._opacity = server.scene, opacity
        self.meshes: list[viser.MeshHandle] = []
        self._root = self._frame(name, position=place)
        self._ball = self._frame(f"{name}/ball")
        self._body = self._frame(f"{name}/body")
        self._wheels = []
        self._add(f"{name}/ball", look.ball, smooth=True)
        self._add(f"{name}/body", look.body)
        for i, wheel in enumerate(look.wheels):
            mount = f"{name}/body/wheel_{i}"
            self._frame(mount, position=wheel.mount[:3, 3], wxyz=quaternion_of(wheel.mount[:3, :3]))
            self._wheels.append((self._frame(f"{mount}/turned"), wheel.axle))
            self._add(f"{mount}/turned", wheel.pieces)

    def _frame(self, name: str, **pose: Any) -> viser.FrameHandle:
        return self._scene.add_frame(name, show_axes=False, **pose)

    def _add(self, name: str, pieces: list[Piece], *, smooth: bool = False) -> None:
        for i, one in enumerate(pieces):
            mesh = self._scene.add_mesh_simple(
                f"{name}/piece_{i}",
                one.vertices,
                one.faces,
                color=one.color,
                flat_shading=not smooth,
                opacity=self._opacity,
                cast_shadow=self._opacity is None,
            )
            self.meshes.append(mesh)

    def show(self, state: FloatArray) -> None:
        """Moves the robot."""
        self._ball.position = state[BALL_POSITION]
        self._ball.wxyz = state[BALL_QUATERNION]
        self._body.position = state[BODY_POSITION]
        self._body.wxyz = state[BODY_QUATERNION]
        for (node, axle), angle in zip(self._wheels, state[WHEEL_ANGLES], strict=True):
            node.wxyz = np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axle)])

    def remove(self) -> None:
        """Takes the robot away."""
        self._root.remove()


def quaternion_of(rotation: FloatArray) -> tuple[float, float, float, float]:
    """`[w, x, y, z]` of a rotation matrix."""
    w, x, y, z = viser.transforms.SO3.from_matrix(rotation).wxyz
    return float(w), float(x), float(y), float(z)
