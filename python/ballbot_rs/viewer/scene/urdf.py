"""The look of a robot that is described by two URDFs."""

import functools
import io
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
import yourdfpy

from ballbot_rs import _assets
from ballbot_rs._core import Params
from ballbot_rs._reading import read_regular
from ballbot_rs.media.shapes import COLORS
from ballbot_rs.viewer.scene.look import Color, Look, Piece, Wheel, ball_of, by_color, piece

#: Largest URDF and largest mesh file, bytes, and most triangles of a mesh: the limits of the core.
MAX_URDF = 16 << 20
MAX_MESH = 128 << 20
MAX_TRIANGLES = 2_000_000

#: The robots that have URDFs.
URDFS = {"paper": (_assets.path("bot.urdf"), _assets.path("ball.urdf"))}


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
    lift[2, 3] = (params.ball_radius + params.wheel_radius) * math.cos(params.wheel_zeniths[0]) - mounts[0][2, 3]
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
        return COLORS["tyre"]
    red, green, blue = (round(255.0 * float(part)) for part in material.color.rgba[:3])
    return red, green, blue
