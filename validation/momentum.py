"""Momentum of a state, only from the conventions: no line is shared with the models it checks."""

import numpy as np

import ballbot_rs as bb
from validation.engines.rotations import matrix
from validation.mechanics import Array, turn, wheel_directions


def rotation(params: bb.Params, state: bb.State, back: float = 0.0) -> tuple[Array, float]:
    """Angular momentum of the bot about its CoM (inertial frame, kg·m²/s) and its energy of rotation (J).

    The attitude is taken `back` seconds earlier: after steps that turn the body by the rate at their end, the rate lags
    by half a step.
    """
    rate, spin = state.body_angular_velocity, wheel_spin(params, state)
    inertia = np.array(params.body_inertia)
    seen = inertia * rate - params.wheel_inertia * wheel_directions(params).T @ spin
    size = float(np.linalg.norm(rate))
    attitude = matrix(state.body_quaternion)
    if size > 0.0:
        attitude = attitude @ turn(rate / size, -size * back)
    return attitude @ seen, 0.5 * float(rate @ (inertia * rate) + params.wheel_inertia * spin @ spin)


def wheel_spin(params: bb.Params, state: bb.State) -> Array:
    """Spin of each wheel in space about its axle −u_i, rad/s."""
    return state.wheel_speeds - wheel_directions(params) @ state.body_angular_velocity


def linear(params: bb.Params, state: bb.State) -> Array:
    """Momentum of ball and bot, kg·m/s."""
    return params.ball_mass * state.ball_velocity + params.body_mass * com_velocity(params, state)


def about_vertical(params: bb.Params, state: bb.State) -> float:
    """Angular momentum of ball and bot about the vertical through the origin, kg·m²/s."""
    p, attitude = params, matrix(state.body_quaternion)
    com = state.body_position + attitude @ [0.0, 0.0, p.body_com_height]
    orbital = p.ball_mass * np.cross(state.ball_position, state.ball_velocity)
    orbital += p.body_mass * np.cross(com, com_velocity(p, state))
    spin = p.ball_inertia * state.ball_angular_velocity + rotation(p, state)[0]
    return float(orbital[2] + spin[2])


def com_velocity(params: bb.Params, state: bb.State) -> Array:
    """Velocity of the body's CoM, inertial frame, m/s."""
    arm = np.cross(state.body_angular_velocity, [0.0, 0.0, params.body_com_height])
    velocity: Array = state.body_velocity + matrix(state.body_quaternion) @ arm
    return velocity
