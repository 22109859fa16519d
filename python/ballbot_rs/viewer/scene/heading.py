"""The heading of a robot, and its marks: an arrowhead on the floor in front of the ball, a cone on the body."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from ballbot_rs._state_rows import BODY_QUATERNION
from ballbot_rs.viewer.scene.look import Color, Look, Piece, piece

FloatArray = npt.NDArray[np.float64]

#: Of no other part of the scene.
COLOR: Final[Color] = (126, 58, 210)

#: Distances of the arrowhead's tip and back from the ball's center, half its width, and height above the floor, m.
TIP, BACK, WIDTH, HEIGHT = 0.215, 0.145, 0.055, 0.005

#: Length and radius of the cone, m, and the upper part of the body that it is on.
CONE: Final = (0.07, 0.024)
UPPER: Final = 0.25


def heading_of(state: FloatArray) -> float:
    """The yaw of the heading frame, rad."""
    w, _, _, z = state[BODY_QUATERNION].tolist()
    return 2.0 * math.atan2(z, w)


def about_z(angle: float) -> tuple[float, float, float, float]:
    """`[w, x, y, z]` of a rotation about the vertical."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def on_floor() -> Piece:
    """The arrowhead, in the frame of the heading."""
    notch = BACK + 0.3 * (TIP - BACK)
    corners = [(TIP, 0.0), (BACK, WIDTH), (notch, 0.0), (BACK, -WIDTH)]
    vertices = np.array([(x, y, HEIGHT) for x, y in corners])
    return Piece(vertices, np.array([(0, 1, 2), (0, 2, 3)]), COLOR)


def on_body(look: Look) -> Piece:
    """The cone, in the body frame: at the front of the upper part of the body."""
    vertices = np.concatenate([one.vertices for one in look.body])
    top = float(vertices[:, 2].max())
    upper = vertices[vertices[:, 2] >= (1.0 - UPPER) * top]
    front = upper[upper[:, 0].argmax()]
    length, radius = CONE
    # A cone points along its z axis, here forward.
    turned = np.array(
        [[0.0, 0.0, 1.0, front[0]], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, front[2]], [0.0, 0.0, 0.0, 1.0]]
    )
    return piece(trimesh.creation.cone(radius, length, sections=24), COLOR, turned)
