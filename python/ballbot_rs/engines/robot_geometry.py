"""The robot of `ballbot_rs.Params` as links, joints and directions: the basis of its models in other engines.

It is deliberately derived independently of the Rust core: agreement between the two is evidence. Do not replace it by
calls of the core.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs._payloads import payloads_of

Array = npt.NDArray[np.float64]

#: Ratio of a disc's inertias across and about its axle; slightly above 1/2, which MuJoCo rejects by rounding.
_ACROSS = 0.5 * (1.0 + 1e-6)


@dataclasses.dataclass(frozen=True)
class Link:
    """A rigid body: mass (kg), center of mass in the body frame (3, m), inertia about it, body axes (3×3, kg·m²)."""

    mass: float
    com: Array
    inertia: Array


@dataclasses.dataclass(frozen=True)
class RobotGeometry:
    """Geometry and masses in the body frame, whose origin is the ball's center and whose z axis is the mast."""

    params: Params
    #: p_i, unit vectors from the ball's center to each wheel contact, (3, 3).
    contacts: Array
    #: Unit vectors along which the rim of each wheel moves at its contact, (3, 3).
    rims: Array
    #: d_i, unit vectors along which each wheel drives the ball's surface: along the axes of its rollers, (3, 3).
    drives: Array
    #: Unit vectors of the wheel axles; a positive torque pushes the ball along d_i, (3, 3).
    axles: Array
    #: Wheel centers, (3, 3), m.
    centers: Array
    #: Body without its wheels, with its payloads at their places.
    body: Link
    #: Inertia of each wheel about its center, body axes, (3, 3, 3), kg·m².
    wheel_inertias: Array

    @property
    def wheel_map(self) -> Array:
        """Map from a ball rate relative to the body, body frame, to wheel speeds: (3, 3), dimensionless."""
        # The ball's surface and the rim move alike along the axes of the rollers.
        surface = np.cross(self.contacts, self.drives) * self.params.ball_radius
        rims = self.params.wheel_radius * np.sum(self.rims * self.drives, axis=1, keepdims=True)
        return np.asarray(surface / rims)


def _offset_inertia(mass: float, offset: Array) -> Array:
    """Inertia of a point mass at an offset, (3, 3), kg·m²."""
    return np.asarray(mass * (offset @ offset * np.eye(3) - np.outer(offset, offset)))


def without_payloads(body: Link, params: Params) -> Link:
    """The body without the payloads of `params`, as point masses at their places."""
    for payload in payloads_of(params):
        load, place = payload.mass, np.array(payload.position)
        mass = body.mass - load
        com = (body.mass * body.com - load * place) / mass
        inertia = body.inertia - _offset_inertia(mass, com - body.com) - _offset_inertia(load, place - body.com)
        body = Link(mass, com, inertia)
    return body


def robot_geometry(params: Params | None = None) -> RobotGeometry:
    """The paper's robot, or the robot of `params`.

    Body and wheels together have the mass properties of the parameters; a wheel is a thin disc, whose inertia about
    its axle is a separate parameter.
    """
    params = Params.paper() if params is None else params
    azimuth = np.array(params.wheel_azimuths)
    zenith = (params.wheel_zenith + np.array(params.wheel_zenith_offsets))[:, np.newaxis]
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=1)
    contacts = np.sin(zenith) * flat + np.cos(zenith) * np.array([0.0, 0.0, 1.0])
    rims = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(3)], axis=1)
    axles = -np.cross(contacts, rims)
    # Rotated about the outward normal; the axle points away from the mast.
    drives = np.cos(params.roller_angle) * rims - np.sin(params.roller_angle) * axles
    centers = contacts * (params.ball_radius + params.wheel_radius)

    whole_com = np.array([*params.body_com_offset, params.body_com_height])
    mass = params.body_mass - 3.0 * params.wheel_mass
    com = (params.body_mass * whole_com - params.wheel_mass * centers.sum(axis=0)) / mass
    xy, xz, yz = params.body_products_of_inertia
    products = np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    inertia = np.diag(params.body_inertia) + products - _offset_inertia(mass, com - whole_com)
    wheel_inertias = []
    for axle, center in zip(axles, centers, strict=True):
        about_axle, across = np.outer(axle, axle), _ACROSS * params.wheel_inertia
        inertia -= across * (np.eye(3) - about_axle) + _offset_inertia(params.wheel_mass, center - whole_com)
        wheel_inertias.append(across * (np.eye(3) - about_axle) + params.wheel_inertia * about_axle)
    # Rounding errors off the diagonal would make Bullet rotate the frame.
    inertia[np.abs(inertia) < 1e-12 * np.abs(inertia).max()] = 0.0
    body = Link(mass, com, inertia)
    return RobotGeometry(params, contacts, rims, drives, axles, centers, body, np.array(wheel_inertias))
