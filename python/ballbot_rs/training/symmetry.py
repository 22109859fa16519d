"""The symmetries of three wheels 120 degrees apart: turns by 120 degrees, and a mirror through the first wheel.

Turned or mirrored torques turn or mirror the motion. Each pair of an observation and an action therefore gives six.
"""

import functools
import math
import re
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch
from ballbot_rs._payloads import Payload, payloads_of
from ballbot_rs.envs.family import robots_in
from ballbot_rs.envs.registration import description_of
from ballbot_rs.envs.spaces import history_ages

Matrix = npt.NDArray[np.float64]

#: Azimuths of wheels with all symmetries, rad.
WHEEL_AZIMUTHS: Final = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)
AZIMUTH_TOLERANCE: Final = 1e-6

#: Length below which the rest of a vector is rounding.
_DEPENDENT: Final = 1e-6

#: Names of the rows that are components of a vector, and of rows of wheels.
_VECTOR = re.compile(r"(?P<quantity>.*?)(?P<frame>, body|, heading| about body) (?P<axis>[xyz])")
_WHEEL = re.compile(r"(?P<quantity>wheel speed|last action, wheel) (?P<wheel>[012])")
#: Rows that a mirror reverses, and rows that no symmetry changes.
_TURNS: Final = ("commanded rate of the heading", "error of the heading's rate")
_SCALARS: Final = ("distance of the goal",)
#: Rows that the opposite motion has alike; it has all others reversed.
_ALIKE: Final = ("gravity direction, body z", *_SCALARS)

#: Turns the wheels: what wheel 0 does, wheel 1 does.
_TURNED_WHEELS: Matrix = np.roll(np.eye(3), 1, axis=0)
#: A mirror reverses all wheels, and exchanges the second and the third wheel.
_MIRRORED_WHEELS: Matrix = -np.eye(3)[[0, 2, 1]]
_HALF, _SINE = -0.5, np.sqrt(0.75)
_TURNED: Matrix = np.array([[_HALF, -_SINE, 0.0], [_SINE, _HALF, 0.0], [0.0, 0.0, 1.0]])
_MIRRORED: Matrix = np.diag([1.0, -1.0, 1.0])


def symmetries(rows: tuple[str, ...], ages: int) -> list[tuple[Matrix, Matrix]]:
    """Six pairs of matrices: a vector of observations times the first, with the action times the second, is also true.

    Args:
        rows: names of the rows of an observation.
        ages: how many observations are given together.

    Raises:
        ValueError: a row that the symmetries of a robot do not map to rows.
    """
    turn = _on_rows(rows, _TURNED, _TURNED, _TURNED_WHEELS)
    # Rates are axial vectors.
    mirror = _on_rows(rows, _MIRRORED, -_MIRRORED, _MIRRORED_WHEELS)
    found = []
    for turns in range(3):
        for is_mirrored in (False, True):
            steps = [turn] * turns + [mirror] * is_mirrored
            wheels = [_TURNED_WHEELS] * turns + [_MIRRORED_WHEELS] * is_mirrored
            of_rows = functools.reduce(np.matmul, steps, np.eye(len(rows)))
            of_wheels = functools.reduce(np.matmul, wheels, np.eye(3))
            found.append((np.kron(np.eye(ages), of_rows).T, of_wheels.T))
    return found


def opposite(rows: tuple[str, ...], ages: int) -> Matrix:
    """The matrix of the opposite motion on observations: where motions are small, reversed torques make it.

    Args:
        rows: names of the rows of an observation.
        ages: how many observations are given together.
    """
    return np.diag(np.tile([1.0 if name in _ALIKE else -1.0 for name in rows], ages))


def _is_symmetric(payload: Payload) -> bool:
    """Whether a payload stays the same when the robot is turned or mirrored."""
    across = (*payload.position[:2], *payload.amplitude[:2])
    return not any(across) and all(x == y for x, y, _ in (payload.stiffness, payload.damping))


def of_batch(batch: Batch) -> list[tuple[Matrix, Matrix]]:
    """The `symmetries` of the robots of a batch and its observations.

    Raises:
        ValueError: robots whose wheels are not alike or have inclined rollers, or rows without symmetry.
    """
    for i, robot in enumerate(robots_in(batch)):
        apart = np.subtract(robot.wheel_azimuths, WHEEL_AZIMUTHS)
        apart -= 2.0 * math.pi * np.round(apart / (2.0 * math.pi))
        if any(robot.wheel_zenith_offsets) or np.abs(apart).max() > AZIMUTH_TOLERANCE:
            raise ValueError(
                f"the wheels of robot {i} are not identical and 120 degrees apart, starting at x: "
                f"wheel_azimuths = {robot.wheel_azimuths}, wheel_zenith_offsets = {robot.wheel_zenith_offsets}"
            )
        if not all(map(_is_symmetric, payloads_of(robot))):
            raise ValueError(f"a payload of robot {i} is not the same in all directions about the mast")
        if robot.roller_angle != 0.0:
            raise ValueError(f"a mirror reverses roller_angle = {robot.roller_angle} of robot {i}: it must be 0")
    return symmetries(*_rows_of(batch))


def opposite_of_batch(batch: Batch) -> Matrix:
    """The matrix `opposite` for the observations of a batch.

    Raises:
        ValueError: rows without symmetry.
    """
    return opposite(*_rows_of(batch))


def _rows_of(batch: Batch) -> tuple[tuple[str, ...], int]:
    """The names of the rows of an observation, and how many observations are given together."""
    rows = tuple(row["name"] for row in description_of(batch.task)["observation"])
    ages = len(history_ages(batch.history))
    if ages * len(rows) != batch.observation_len:
        raise ValueError("instruments and added rows have no symmetry")
    return rows, ages


def linear_policies(pairs: list[tuple[Matrix, Matrix]]) -> Matrix:
    """All linear policies that turn and mirror with the robot: an orthonormal basis, of shape (n, 3, observations).

    Args:
        pairs: of `symmetries`.
    """
    # The mean over a group projects on what each of its symmetries leaves unchanged.
    projection = np.mean([np.kron(of_wheels, of_rows) for of_rows, of_wheels in pairs], axis=0)
    basis: list[Matrix] = []
    for column in projection.T:
        rest = column - sum((other * (other @ column) for other in basis), np.zeros(len(column)))
        if (length := np.linalg.norm(rest)) > _DEPENDENT:
            basis.append(rest / length)
    return np.reshape(basis, (-1, 3, len(pairs[0][0])))


def kinds(pairs: list[tuple[Matrix, Matrix]]) -> npt.NDArray[np.int64]:
    """The number of each row's kind, from 0 on: rows that symmetries map to each other are of a kind.

    Args:
        pairs: of `symmetries`.
    """
    mapped = np.any([of_rows != 0.0 for of_rows, _ in pairs], axis=0)
    # Row i of `mapped` is the orbit of row i, as the pairs are a group.
    firsts = mapped.argmax(axis=1)
    return np.unique(firsts, return_inverse=True)[1].astype(np.int64)


def _on_rows(rows: tuple[str, ...], polar: Matrix, axial: Matrix, wheels: Matrix) -> Matrix:
    """The matrix of a symmetry on the rows of an observation."""
    matrix = np.zeros((len(rows), len(rows)))
    for i, name in enumerate(rows):
        if name in _TURNS or name in _SCALARS:
            # The vertical component of an axial vector, or no vector.
            matrix[i, i] = axial[2, 2] if name in _TURNS else 1.0
            continue
        if of_wheel := _WHEEL.fullmatch(name):
            parts = [f"{of_wheel['quantity']} {wheel}" for wheel in range(3)]
            weights = wheels[int(of_wheel["wheel"])]
        elif vector := _VECTOR.fullmatch(name):
            parts = [f"{vector['quantity']}{vector['frame']} {axis}" for axis in "xyz"]
            of = axial if vector["frame"] == " about body" else polar
            weights = of["xyz".index(vector["axis"])]
        else:
            raise ValueError(f"the row '{name}' is neither of a wheel nor of a vector, so it has no symmetry")
        for part, weight in zip(parts, weights, strict=True):
            if weight != 0.0:
                matrix[i, rows.index(part)] = weight
    return matrix
