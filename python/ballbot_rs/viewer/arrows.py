"""Flat arrows on the floor: the number of triangles is constant, so that scene nodes only need new vertices."""

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Half widths of shaft and head, and largest length of the head, m.
SHAFT, HEAD, HEAD_LENGTH = 0.012, 0.035, 0.07

#: Height above the floor, m: the grid is at 0.
HEIGHT = 0.006

#: Segments of a shaft.
PIECES = 24

#: Corner numbers: the shaft in pairs from the tail, then two of the head and the tip.
FACES: npt.NDArray[np.int64] = np.array(
    [
        *[(2 * i, 2 * i + 1, 2 * i + 3) for i in range(PIECES)],
        *[(2 * i, 2 * i + 3, 2 * i + 2) for i in range(PIECES)],
        (2 * PIECES + 2, 2 * PIECES + 3, 2 * PIECES + 4),
    ]
)


def straight(tail: float, length: float) -> FloatArray:
    """Corners of an arrow along x, starting at a distance from the origin, m, shape (k, 3)."""
    ways, sides = _outline(length, HEAD_LENGTH)
    return _on_floor(tail + ways, sides)


def arc(radius: float, angle: float) -> FloatArray:
    """Corners of an arrow along a circle about the origin, from x, counterclockwise for a positive angle, rad."""
    angles, sides = _outline(angle, HEAD_LENGTH / radius)
    return _on_floor((radius + sides) * np.cos(angles), (radius + sides) * np.sin(angles))


def _outline(length: float, head_length: float) -> tuple[FloatArray, FloatArray]:
    """Positions along an arrow, and lateral offsets."""
    neck = length - math.copysign(min(head_length, 0.5 * abs(length)), length)
    ways = np.append(np.repeat(np.linspace(0.0, neck, PIECES + 1), 2), [neck, neck, length])
    sides = np.append(np.tile([-SHAFT, SHAFT], PIECES + 1), [-HEAD, HEAD, 0.0])
    return ways, sides


def _on_floor(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.stack([x, y, np.full_like(x, HEIGHT)], axis=1)
