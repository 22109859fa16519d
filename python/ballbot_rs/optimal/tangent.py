"""Differences of states in the coordinates of `Jacobian.states`."""

import numpy as np
import numpy.typing as npt

from ballbot_rs._quaternions import conjugate, product, rotation_vector

Array = npt.NDArray[np.float64]

#: Numbers of a state, `State.to_array`, and coordinates of its changes.
NUMBERS, COORDINATES = 32, 30

#: Where each coordinate that is a difference of numbers has its number.
_PLACES = {0: 0, 6: 13, 12: 26, 15: 7, 18: 10, 21: 20, 24: 23, 27: 29}


def difference(state: Array, origin: Array) -> Array:
    """The change from `origin` to `state`, rows as `State.to_array`, shape (..., 32): shape (..., 30).

    A change of an attitude is a rotation vector, of the ball in the inertial frame, of the body in the body frame.
    """
    out = np.empty((*np.broadcast_shapes(state.shape, origin.shape)[:-1], COORDINATES))
    for coordinate, number in _PLACES.items():
        out[..., coordinate : coordinate + 3] = state[..., number : number + 3] - origin[..., number : number + 3]
    out[..., 3:6] = rotation_vector(product(state[..., 3:7], conjugate(origin[..., 3:7])))
    out[..., 9:12] = rotation_vector(product(conjugate(origin[..., 16:20]), state[..., 16:20]))
    return out


def inverse_right_jacobian(vector: Array) -> Array:
    """Change of a rotation vector, shape (n, 3), by a small rotation in the rotated frame, shape (n, 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    square = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)))
    cross = np.zeros((*vector.shape, 3))
    for axis, i, j in [(0, 1, 2), (1, 2, 0), (2, 0, 1)]:
        cross[..., i, j], cross[..., j, i] = -vector[..., axis], vector[..., axis]
    return np.asarray(np.eye(3) + 0.5 * cross + square[..., None, None] * (cross @ cross))


def numbers_by_change(states: Array) -> Array:
    """The numbers of states, shape (n, 32), by changes of the states: shape (n, 32, 30)."""
    out = np.zeros((len(states), NUMBERS, COORDINATES))
    for coordinate, number in _PLACES.items():
        out[:, range(number, number + 3), range(coordinate, coordinate + 3)] = 1.0
    for axis in range(3):
        vector = np.eye(4)[1 + axis]
        out[:, 3:7, 3 + axis] = 0.5 * product(vector, states[:, 3:7])
        out[:, 16:20, 9 + axis] = 0.5 * product(states[:, 16:20], vector)
    return out


def change_by_numbers(states: Array) -> Array:
    """Changes of the states by their numbers, along which quaternions stay of unit length: shape (n, 30, 32)."""
    out: Array = numbers_by_change(states).transpose(0, 2, 1).copy()
    # The columns of a quaternion are orthogonal, of length 1/2.
    out[:, 3:6] *= 4.0
    out[:, 9:12] *= 4.0
    return out
