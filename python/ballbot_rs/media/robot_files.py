"""Robots as URDFs, for RViz, MuJoCo and other programs."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _files
from ballbot_rs._core import Params
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.engines.robot_geometry import Link, RobotGeometry, robot_geometry
from ballbot_rs.media.shapes import COLORS, Shape, body_of, wheel_of

#: What a URDF may contain.
PARTS: Final = ("robot", "bot", "ball")

#: Velocity limit of the wheel joints, rad/s: readers need a finite number, and the motors' is not a parameter.
_NO_LIMIT = 1e6


@named
def write_urdf(robot: Robot, path: str | PathLike[str], part: str = "robot") -> Path:
    """Writes a robot as a URDF, in SI units, with primitive shapes.

    ```python
    bb.write_urdf("kugle", "kugle.urdf")
    ```

    Links: `base_link`, the body without wheels, whose frame is the body frame of docs/conventions.md (origin at the
    ball's center, z along the mast); `wheel_0`, `wheel_1`, `wheel_2`, with x towards the ball's center, y along the
    drive direction and z along the axle; `ball`, with the origin at its center; `odom`, the root, a point of the floor.
    Joints: `base_link_joint` and `ball_joint`, floating, from `odom`; `wheel_joint_0` to `wheel_joint_2`, continuous,
    about the axle in the sense of `wheel_angles`.

    The inertial of the body is what remains of `body_mass`, `body_inertia`, products of inertia and CoM, on the mast or
    off it, minus three thin wheel discs. Where heavy wheels leave a moment of inertia larger than the sum of the
    two others, MuJoCo rejects the file. The wheel joints have `wheel_viscous_friction`,
    `wheel_coulomb_friction` and `max_wheel_torque`. A URDF cannot hold gravity, the tilt of the floor, friction of
    ball, floor and rollers, the rollers' ripple and angle, the wheels' preload, springs of payloads, which are fixed,
    motors and sensors; the velocity limit is 1e6 rad/s, in effect none.

    Args:
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters.
        path: of the file, with the suffix `.urdf`.
        part: "robot": all of it, for RViz and MuJoCo. "bot" and "ball": the two files that `Params.from_urdf` reads,
            with the roots `base_link` and `ball`.

    Raises:
        ValueError: another suffix or part; wheels that leave the body no inertia.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".urdf":
        raise InvalidInputError(f"{path}: a robot is written as .urdf, not '{path.suffix}'")
    if part not in PARTS:
        raise InvalidInputError(f"part = {part!r} is unknown: expected one of {', '.join(PARTS)}")
    geometry = robot_geometry(params_of(robot))
    root = ET.Element("robot", name="ballbot" if part == "robot" else part)
    for name, color in COLORS.items():
        rgba = " ".join(f"{value / 255.0:.3g}" for value in color)
        ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=f"{rgba} 1")
    if part == "robot":
        ET.SubElement(root, "link", name="odom")
        for child in ("base_link", "ball"):
            center = (0.0, 0.0, geometry.params.ball_radius)
            _joint(root, f"{child}_joint", "floating", "odom", child, center)
    if part != "ball":
        _add_bot(root, geometry)
    if part != "bot":
        _add_ball(root, geometry.params)
    ET.indent(root)
    _files.write(path, f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n')
    return path


def _add_ball(root: ET.Element, p: Params) -> None:
    ball = _link(root, "ball", Link(p.ball_mass, np.zeros(3), p.ball_inertia * np.eye(3)))
    _visual(ball, Shape("sphere", (p.ball_radius,), "rubber"))
    _shape(ball, "collision", "sphere", radius=p.ball_radius)


def _add_bot(root: ET.Element, robot: RobotGeometry) -> None:
    p = robot.params
    _check_body(robot.body)
    body = _link(root, "base_link", robot.body)
    # The cylinder of the models `contact` and `rigid`.
    bottom = 1.05 * p.ball_radius
    top = max(p.body_com_height + p.slender_half_length, bottom + p.wheel_radius)
    radius = (p.ball_radius + p.wheel_radius) * math.sin(max(p.wheel_zeniths))
    middle, length = (0.0, 0.0, 0.5 * (bottom + top)), top - bottom
    _shape(body, "collision", "cylinder", middle, radius=radius, length=length)
    for shape in body_of(robot):
        _visual(body, shape)
    across = float(np.trace(robot.wheel_inertias[0]) - p.wheel_inertia) / 2.0
    inertia = np.diag([across, across, p.wheel_inertia])
    for i in range(3):
        wheel = _link(root, f"wheel_{i}", Link(p.wheel_mass, np.zeros(3), inertia))
        for shape in wheel_of(p.wheel_radius):
            _visual(wheel, shape)
        # An omniwheel touches the ball at one point and slides freely along its axle.
        _shape(wheel, "collision", "sphere", radius=p.wheel_radius)
    for i, (zenith, azimuth) in enumerate(zip(p.wheel_zeniths, p.wheel_azimuths, strict=True)):
        turned = (0.0, zenith + 0.5 * math.pi, azimuth)
        joint = _joint(
            root, f"wheel_joint_{i}", "continuous", "base_link", f"wheel_{i}", robot.centers[i].tolist(), turned
        )
        ET.SubElement(joint, "axis", xyz="0 0 1")
        friction = {"damping": p.wheel_viscous_friction, "friction": p.wheel_coulomb_friction}
        ET.SubElement(joint, "dynamics", {name: _numbers([value]) for name, value in friction.items()})
        ET.SubElement(joint, "limit", effort=_numbers([p.max_wheel_torque]), velocity=_numbers([_NO_LIMIT]))


def _check_body(body: Link) -> None:
    """Raises ValueError for a body whose inertia is not positive definite, which readers of URDFs reject."""
    least = float(np.linalg.eigvalsh(body.inertia)[0])
    if least <= 0.0:
        raise InvalidInputError(
            "a URDF needs the body without its wheels, whose least moment of inertia would be "
            f"{least:.6g} kg·m²: it must be > 0; reduce wheel_mass or wheel_inertia, or increase body_inertia"
        )


def _link(root: ET.Element, name: str, link: Link) -> ET.Element:
    element = ET.SubElement(root, "link", name=name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(link.com))
    ET.SubElement(inertial, "mass", value=_numbers([link.mass]))
    terms = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {term: _numbers([link.inertia[at]]) for term, at in terms.items()})
    return element


def _joint(
    root: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    xyz: Sequence[float],
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _visual(link: ET.Element, shape: Shape) -> None:
    names = {"box": (), "cylinder": ("radius", "length"), "sphere": ("radius",)}[shape.kind]
    sizes = dict(zip(names, shape.size, strict=True)) if names else {"size": shape.size}
    element = _shape(link, "visual", shape.kind, shape.position, shape.rpy, **sizes)
    ET.SubElement(element, "material", name=shape.color)


def _shape(
    link: ET.Element,
    kind: str,
    shape: str,
    xyz: Sequence[float] = (0.0, 0.0, 0.0),
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
    **sizes: float | Sequence[float],
) -> ET.Element:
    element = ET.SubElement(link, kind)
    ET.SubElement(element, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))
    sized = {name: _numbers([size] if isinstance(size, float) else size) for name, size in sizes.items()}
    ET.SubElement(ET.SubElement(element, "geometry"), shape, sized)
    return element


def _numbers(values: Sequence[float] | npt.NDArray[np.float64]) -> str:
    return " ".join(f"{value:.17g}" for value in values)
