"""A state with its slip removed, for models without slip."""

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params, State, Terrain

FloatArray = npt.NDArray[np.float64]


def rolling(params: Params, state: State, plane: Terrain | None) -> State:
    """The ball rolls with its velocity, attitude and rate of the body remain, and all parts are in contact.

    Args:
        params: the robot.
        state: any state.
        plane: the ground, a plane; None is level.
    """
    up = np.array([0.0, 0.0, 1.0]) if plane is None else plane.normal(0.0, 0.0)
    # From the inertial frame to a frame with the ground's normal as its z axis.
    level = _rotation_to_vertical(up)
    there = _conjugate(level)
    velocity = _turn(level, state.ball_velocity)
    found = State.rolling(params, velocity[:2], _product(level, state.body_quaternion), state.body_angular_velocity)
    # The ground passes through the origin.
    position = state.ball_position + (params.ball_radius - state.ball_position @ up) * up
    return found.replace(
        ball_position=position,
        body_position=position,
        ball_quaternion=state.ball_quaternion,
        ball_velocity=_turn(there, found.ball_velocity),
        ball_angular_velocity=_turn(there, found.ball_angular_velocity),
        body_quaternion=state.body_quaternion,
        body_velocity=_turn(there, found.body_velocity),
        wheel_angles=state.wheel_angles,
    )


def _rotation_to_vertical(up: FloatArray) -> FloatArray:
    """The shortest rotation, (w, x, y, z), of a unit vector above the horizontal plane to the vertical."""
    quaternion = np.array([1.0 + up[2], up[1], -up[0], 0.0])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def _conjugate(quaternion: FloatArray) -> FloatArray:
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]))


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    vector = first[0] * second[1:] + second[0] * first[1:] + np.cross(first[1:], second[1:])
    return np.append(first[0] * second[0] - first[1:] @ second[1:], vector)


def _turn(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    return _product(_product(quaternion, np.append(0.0, vector)), _conjugate(quaternion))[1:]
