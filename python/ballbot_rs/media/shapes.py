"""Robots as boxes, cylinders and spheres: published robots from their dimensions, others from `Params`."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs.engines.robot_geometry import RobotGeometry
from ballbot_rs.envs._render import GEOMETRY

Array = npt.NDArray[np.float64]
Place = tuple[float, float, float]

#: Names of colors and their red, green and blue.
COLORS: Final = {
    "rubber": (204, 56, 46),
    "plate": (72, 78, 90),
    "frame": (190, 195, 203),
    "dark": (41, 43, 48),
    "steel": (140, 145, 153),
    "white": (236, 238, 241),
    "tyre": (26, 76, 140),
    "battery": (240, 140, 26),
    "glass": (24, 32, 46),
}

#: Largest relative difference of the height of the center of mass at which a robot counts as the published one.
_HEIGHT_TOLERANCE = 0.2

#: Rollers in each of a wheel's two rows, and their radius and the hub's in wheel radii.
_ROLLERS, _ROLLER, _HUB = 9, 0.2, 0.88


@dataclasses.dataclass(frozen=True)
class Shape:
    """A primitive shape at a pose."""

    #: "box": lengths of its edges; "cylinder" along z: radius and length; "sphere": radius. m.
    kind: str
    size: tuple[float, ...]
    #: A name in `COLORS`.
    color: str
    position: Place = (0.0, 0.0, 0.0)
    #: Roll, pitch and yaw as in a URDF, rad.
    rpy: Place = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Array:
        """Homogeneous transform, (4, 4)."""
        (cr, cp, cy), (sr, sp, sy) = np.cos(self.rpy), np.sin(self.rpy)
        found = np.eye(4)
        found[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        found[:3, 3] = self.position
        return found


def wheel_of(radius: float) -> list[Shape]:
    """An omniwheel in its frame: the axle along z, two rows of rollers between the discs of a hub.

    A flat mark on the outside shows how it turns.
    """
    row, reach = 0.2 * radius, (1.0 - _ROLLER) * radius
    found = [
        Shape("cylinder", (_HUB * radius, 0.1 * radius), "dark", (0.0, 0.0, z)) for z in (-2.0 * row, 0.0, 2.0 * row)
    ]
    found += [
        Shape(
            "sphere",
            (_ROLLER * radius,),
            "tyre",
            (reach * math.cos(angle), reach * math.sin(angle), side * row),
        )
        for side in (-1.0, 1.0)
        for angle in math.pi / _ROLLERS * (2.0 * np.arange(_ROLLERS) + 0.5 * (side + 1.0))
    ]
    found.append(Shape("box", (1.4 * radius, 0.16 * radius, 0.06 * radius), "battery", (0.0, 0.0, 2.3 * row)))
    return found


def body_of(robot: RobotGeometry) -> list[Shape]:
    """The body without its wheels, in the body frame."""
    make = published(robot.params)
    return list(_any(robot) if make is None else make(robot))


def published(params: Params) -> Callable[[RobotGeometry], Iterator[Shape]] | None:
    """Makes the body of the published robot with the dimensions of `params`; None for another robot."""
    for name, make in _PUBLISHED.items():
        preset = Params.preset(name)
        fits = all(np.allclose(getattr(params, part), getattr(preset, part), rtol=1e-3) for part in GEOMETRY)
        if fits and abs(params.body_com_height / preset.body_com_height - 1.0) < _HEIGHT_TOLERANCE:
            return make
    return None


def _any(robot: RobotGeometry) -> Iterator[Shape]:
    """A plate and a mast; parameters have no outlines, so the inertia determines the height."""
    p = robot.params
    radius = (p.ball_radius + p.wheel_radius) * math.sin(max(p.wheel_zeniths))
    plate = float(max(robot.centers[:, 2])) + 1.6 * p.wheel_radius
    top = max(p.body_com_height + p.slender_half_length, 1.05 * p.ball_radius + p.wheel_radius, plate + p.wheel_radius)
    yield from _drives(robot, 0.36 * p.wheel_radius, 0.34 * p.wheel_radius, 1.4 * p.wheel_radius)
    yield from _stack(radius, (plate, 0.5 * (plate + top), top), posts=3)


def _kugle(robot: RobotGeometry) -> Iterator[Shape]:
    """Kugle V1, github.com/mindThomas/Kugle-ROS and Kugle-MATLAB, and data sheets of the parts that they name.

    From there: the places of the two SICK TiM571 (60 × 61 × 86 mm) and of the RealSense camera (90 × 25 mm); flat
    motors of 60 mm with gearheads of 42 mm. Estimates: plates, posts, batteries and the tablet in between.
    """
    yield from _drives(robot, 0.03, 0.021, 0.09)
    yield from _stack(0.15, (0.235, 0.40, 0.62), posts=4)
    for side in (-1.0, 1.0):
        yield Shape("box", (0.060, 0.061, 0.08575), "dark", (0.0, 0.123 * side, 0.318))
        yield Shape("cylinder", (0.028, 0.03), "glass", (0.0, 0.123 * side, 0.345))
        yield Shape("box", (0.135, 0.045, 0.05), "battery", (0.0, 0.05 * side, 0.43))
    yield Shape("box", (0.12, 0.12, 0.04), "steel", (0.0, 0.0, 0.26))
    yield Shape("box", (0.16, 0.10, 0.06), "dark", (0.0, 0.0, 0.53))
    yield Shape("cylinder", (0.022, 0.46), "frame", (0.0, 0.0, 0.85))
    yield Shape("box", (0.012, 0.25, 0.17), "glass", (0.035, 0.0, 1.0), (0.0, -0.15, 0.0))
    yield Shape("box", (0.025, 0.09, 0.025), "white", (0.05, 0.0, 1.11))


def _rezero(robot: RobotGeometry) -> Iterator[Shape]:
    """Rezero, ETH Zurich: Fankhauser and Gwerder, 2010, and Drives & Controls, 7 June 2012.

    From there: radii of ball and wheels, planetary gearheads of 42 mm. Estimates: a frame of three struts around the
    batteries, with a height of 1 m from the floor.
    """
    yield from _drives(robot, 0.021, 0.021, 0.13)
    yield from _stack(0.15, (0.245,), posts=0)
    yield from _stack(0.09, (0.62,), posts=0)
    up = np.array([0.0, 0.0, 1.0])
    for azimuth in robot.params.wheel_azimuths:
        out = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        across = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        for side in (-0.03, 0.03):
            foot, knee = 0.135 * out + side * across, 0.075 * out + 0.5 * side * across
            yield _rod(foot + 0.245 * up, knee + 0.62 * up, 0.008, "frame")
        yield _rod(0.075 * out + 0.62 * up, 0.05 * out + 0.85 * up, 0.009, "frame")
        yield Shape("box", (0.045, 0.09, 0.14), "battery", _place(0.055 * out + 0.34 * up), (0.0, 0.0, azimuth))
        yield Shape("box", (0.012, 0.07, 0.11), "dark", _place(0.062 * out + 0.52 * up), (0.0, 0.0, azimuth))
    yield Shape("cylinder", (0.07, 0.02), "white", (0.0, 0.0, 0.86))
    yield Shape("cylinder", (0.045, 0.015), "dark", (0.0, 0.0, 0.8775))


def _asroballet(robot: RobotGeometry) -> Iterator[Shape]:
    """asRoBallet, asRoBallet.xml of github.com/asRoBallet/asRoBallet_mujoco: its joints at zero, its capsules.

    From there: places of the joints, capsules of torso, shoulders and arms, spheres of head and hands. Estimates: the
    base from the drives up to the torso.
    """
    yield from _drives(robot, 0.03, 0.025, 0.08)
    yield from _stack(0.13, (0.225, 0.33, 0.44), posts=4)
    yield Shape("box", (0.12, 0.09, 0.07), "battery", (0.0, 0.0, 0.27))
    yield Shape("box", (0.13, 0.10, 0.05), "steel", (0.0, 0.0, 0.37))
    yield Shape("cylinder", (0.035, 0.09), "dark", (0.0, 0.0, 0.485))
    yield from _capsule([0.0, 0.0, 0.52], [0.0, 0.0, 0.84], 0.065, "white")
    yield from _capsule([0.0, -0.11, 0.83], [0.0, 0.11, 0.83], 0.05, "white")
    yield _rod(np.array([0.0, 0.0, 0.9]), np.array([0.02, 0.0, 1.02]), 0.03, "dark")
    yield Shape("sphere", (0.075,), "dark", (0.048, 0.0, 1.062))
    yield Shape("box", (0.02, 0.10, 0.05), "glass", (0.118, 0.0, 1.07))
    for side in (-1.0, 1.0):
        shoulder, elbow = [0.0, 0.211 * side, 0.83], [0.0, 0.211 * side, 0.571]
        yield _rod(np.array([0.0, 0.159 * side, 0.83]), np.array(shoulder), 0.035, "dark")
        yield from _capsule(shoulder, elbow, 0.046, "white")
        yield from _capsule([0.01, 0.211 * side, 0.571], [0.24, 0.211 * side, 0.571], 0.03, "dark")
        yield Shape("sphere", (0.038,), "battery", (0.283, 0.211 * side, 0.571))


_PUBLISHED: Final[dict[str, Callable[[RobotGeometry], Iterator[Shape]]]] = {
    "kugle": _kugle,
    "rezero": _rezero,
    "asroballet": _asroballet,
}


def _drives(robot: RobotGeometry, motor: float, gear: float, length: float) -> Iterator[Shape]:
    """Motor and gearhead behind each wheel, of two radii and a common length, m."""
    p = robot.params
    begin = 0.55 * p.wheel_radius
    for center, axle, zenith, azimuth in zip(
        robot.centers, robot.axles, p.wheel_zeniths, p.wheel_azimuths, strict=True
    ):
        turned = (0.0, zenith + 0.5 * math.pi, azimuth)
        for radius, first, part, color in ((gear, 0.0, 0.45, "steel"), (motor, 0.45, 0.55, "dark")):
            middle = center - (begin + (first + 0.5 * part) * length) * axle
            yield Shape("cylinder", (radius, part * length), color, _place(middle), turned)


def _stack(radius: float, heights: tuple[float, ...], posts: int) -> Iterator[Shape]:
    """Round plates at heights, m, on posts."""
    for height in heights:
        yield Shape("cylinder", (radius, 0.008), "plate", (0.0, 0.0, height))
    for post in range(posts):
        angle = 2.0 * math.pi * (post + 0.5) / posts
        x, y = 0.8 * radius * math.cos(angle), 0.8 * radius * math.sin(angle)
        length = heights[-1] - heights[0]
        yield Shape("cylinder", (0.006, length), "frame", (x, y, heights[0] + 0.5 * length))


def _rod(begin: Array, end: Array, radius: float, color: str) -> Shape:
    """A cylinder between two points, m."""
    way = np.asarray(end) - begin
    length = float(np.linalg.norm(way))
    tilt = (0.0, math.acos(way[2] / length), math.atan2(way[1], way[0]))
    return Shape("cylinder", (radius, length), color, _place(begin + 0.5 * way), tilt)


def _capsule(begin: list[float], end: list[float], radius: float, color: str) -> Iterator[Shape]:
    yield _rod(np.array(begin), np.array(end), radius, color)
    for x, y, z in (begin, end):
        yield Shape("sphere", (radius,), color, (x, y, z))


def _place(point: npt.ArrayLike) -> Place:
    x, y, z = np.asarray(point, dtype=np.float64).tolist()
    return x, y, z
