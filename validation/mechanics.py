"""Closed forms of the robot's mechanics that several topics use."""

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from validation.engines.rotations import matrix

Array = npt.NDArray[np.float64]


def unstable_pole(params: bb.Params, wheel_share: float | None = None, absolute_wheel_spin: bool = True) -> float:
    """Growth rate λ = √(K M₁₁/det M) of a small tilt of the upright robot (1/s), in closed form.

    `wheel_share` is the wheels' inertia in units of J_w: 3/2 cos²α for three wheels, the default. Their absolute spin
    has r_k/r_w + 1 where the spin relative to the body has r_k/r_w.
    """
    mass = upright_mass(params, wheel_share, absolute_wheel_spin)
    topples = params.body_mass * params.gravity * params.body_com_height
    return float(np.sqrt(mass[0, 0] * topples / np.linalg.det(mass)))


def upright_mass(params: bb.Params, wheel_share: float | None = None, absolute_wheel_spin: bool = True) -> Array:
    """M of eq. (2) upright, in position and tilt; arguments as for the pole."""
    p = params
    share = 1.5 * np.cos(p.wheel_zenith) ** 2 if wheel_share is None else wheel_share
    wheels, ratio = share * p.wheel_inertia, p.ball_radius / p.wheel_radius + (1.0 if absolute_wheel_spin else 0.0)
    m11 = p.ball_inertia / p.ball_radius**2 + wheels / p.wheel_radius**2 + p.ball_mass + p.body_mass
    m12 = p.body_mass * p.body_com_height - wheels * ratio / p.wheel_radius
    m22 = p.body_inertia[0] + p.body_mass * p.body_com_height**2 + wheels * ratio**2
    return np.array([[m11, m12], [m12, m22]])


def yaw_gain(params: bb.Params, absolute_wheel_spin: bool = True) -> float:
    """θ̈_z of the upright robot over the virtual torque τ_z on the body, 1/(kg·m²), in closed form.

    Angular momentum about the vertical stays zero; the motors do work on the wheel rates k sin α (s − θ̇_z), and the
    wheels spin in space at sin α (k s − (k + 1) θ̇_z).
    """
    p = params
    ratio = p.ball_radius / p.wheel_radius
    turned = ratio + (1.0 if absolute_wheel_spin else 0.0)
    wheels = 3.0 * p.wheel_inertia * np.sin(p.wheel_zenith) ** 2
    mass = np.array(
        [
            [p.body_inertia[2] + wheels * turned**2, -wheels * turned * ratio],
            [-wheels * turned * ratio, p.ball_inertia + wheels * ratio**2],
        ]
    )
    return float(np.linalg.solve(mass, [ratio, -ratio])[0])


def steady_lean(params: bb.Params, tilt: float, absolute_wheel_spin: bool = True) -> tuple[float, float]:
    """Acceleration (m/s²) and virtual torque (N·m) of a robot that keeps a tilt towards its direction of travel."""
    p = params
    mass, wheels = p.ball_mass + p.body_mass, 1.5 * np.cos(p.wheel_zenith) ** 2 * p.wheel_inertia
    pull = p.body_mass * p.gravity * p.body_com_height * np.sin(tilt)
    held = p.body_mass * p.body_com_height * np.cos(tilt) + mass * p.ball_radius + p.ball_inertia / p.ball_radius
    if absolute_wheel_spin:
        held -= wheels / p.wheel_radius
    acceleration = pull / held
    rolling = mass + p.ball_inertia / p.ball_radius**2 + wheels / p.wheel_radius**2
    return float(acceleration), float(p.wheel_radius * rolling * acceleration)


def leaning(params: bb.Params, tilt: float, azimuth: float, yaw: float, torque: float) -> tuple[bb.State, Array]:
    """A robot at rest that leans towards `azimuth`, and the wheel torques equivalent to a virtual torque that way.

    A virtual wheel turns, like the wheels, at the gear ratio times the ball's rate relative to the body: the wheels do
    the same work about the axis of the ball's rotation if their torques along u_i add up to its torque.
    """
    axis = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    state = bb.State.at_rest(params, tilt * axis[:2], yaw)
    seen = matrix(state.body_quaternion).T @ axis
    return state, np.linalg.solve(wheel_directions(params).T, torque * seen)


def wheel_directions(params: bb.Params) -> Array:
    """Rows u_i = p_i × d_i, body frame: the axis about which each wheel turns the ball."""
    return -robot_geometry(params).axles


def turn(axis: Array, angle: float) -> Array:
    """Rotation matrix about a unit vector."""
    return matrix(np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis)]))
