"""What several topics ask of a robot."""

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from peers.rotations import matrix

Array = npt.NDArray[np.float64]


def unstable_pole(params: bb.Params) -> float:
    """Growth rate of a small tilt (1/s), from the equations of the `spatial` model linearised about rest upright."""
    model = bb.SpatialModel(params)
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    angle = 1e-6
    tilted = np.array([np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0])
    rest, torque = np.zeros(5), np.zeros(3)
    slope = model.accelerations(tilted, rest, torque) - model.accelerations(upright, rest, torque)
    return float(np.sqrt(slope[2] / angle))


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
    """A robot at rest that leans towards `azimuth`, and the wheel torques that amount to a virtual torque that way.

    A virtual wheel turns, as the wheels do, with the gear ratio times the ball's rate relative to the body: the wheels
    do the same work about the axis of the ball's rotation if their torques along u_i add up to its torque.
    """
    axis = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    state = bb.State.upright(params, tilt * axis[:2], yaw)
    seen = matrix(state.body_quaternion).T @ axis
    return state, np.linalg.solve(wheel_directions(params).T, torque * seen)


def wheel_directions(params: bb.Params) -> Array:
    """u_i = p_i × d_i in its rows, body frame: the axis about which each wheel turns the ball."""
    sin, cos = np.sin(params.wheel_zenith), np.cos(params.wheel_zenith)
    return np.array([[-cos * np.cos(b), -cos * np.sin(b), sin] for b in params.wheel_azimuths])


def turn(axis: Array, angle: float) -> Array:
    """Rotation matrix about a unit vector."""
    return matrix(np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis)]))
