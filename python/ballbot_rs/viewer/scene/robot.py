"""A robot in the scene."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._state_rows import (
    BALL_POSITION,
    BALL_QUATERNION,
    BODY_POSITION,
    BODY_QUATERNION,
    WHEEL_ANGLES,
)
from ballbot_rs.viewer.scene import heading
from ballbot_rs.viewer.scene.look import Look, Piece
from ballbot_rs.viewer.scene.payloads import PayloadNodes

FloatArray = npt.NDArray[np.float64]


#: Size of the ball of a transparent robot.
GHOST_SCALE = 0.985


class RobotNodes:
    """The scene nodes of one robot."""

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        look: Look,
        place: tuple[float, float, float],
        opacity: float | None = None,
    ) -> None:
        self._scene, self._opacity = server.scene, opacity
        self.meshes: list[viser.MeshHandle] = []
        self._root = self._frame(name, position=place)
        self._ball = self._frame(f"{name}/ball")
        self._body = self._frame(f"{name}/body")
        #: The robot's payloads.
        self.payloads = PayloadNodes(server, f"{name}/body")
        self._wheels = []
        # The ghost's ball is hidden in the other, where they are at one place.
        self._add(f"{name}/ball", look.ball, smooth=True, scale=1.0 if opacity is None else GHOST_SCALE)
        self._add(f"{name}/body", [*look.body, heading.on_body(look)])
        self._mark = self._frame(f"{name}/heading")
        self._add(f"{name}/heading", [heading.on_floor()], casts=False)
        for i, wheel in enumerate(look.wheels):
            mount = f"{name}/body/wheel_{i}"
            self._frame(mount, position=wheel.mount[:3, 3], wxyz=quaternion_of(wheel.mount[:3, :3]))
            self._wheels.append((self._frame(f"{mount}/turned"), wheel.axle))
            self._add(f"{mount}/turned", wheel.pieces)

    def _frame(self, name: str, **pose: Any) -> viser.FrameHandle:
        return self._scene.add_frame(name, show_axes=False, **pose)

    def _add(
        self, name: str, pieces: list[Piece], *, smooth: bool = False, casts: bool = True, scale: float = 1.0
    ) -> None:
        for i, one in enumerate(pieces):
            mesh = self._scene.add_mesh_simple(
                f"{name}/piece_{i}",
                one.vertices,
                one.faces,
                color=one.color,
                flat_shading=not smooth,
                scale=scale,
                opacity=self._opacity,
                cast_shadow=casts and self._opacity is None,
            )
            self.meshes.append(mesh)

    def show(self, state: FloatArray, ground: float) -> None:
        """Moves the robot, on ground of a height, m."""
        self._mark.position = (*state[BALL_POSITION][:2].tolist(), ground)
        self._mark.wxyz = heading.about_z(heading.heading_of(state))
        self._ball.position = state[BALL_POSITION]
        self._ball.wxyz = state[BALL_QUATERNION]
        self._body.position = state[BODY_POSITION]
        self._body.wxyz = state[BODY_QUATERNION]
        for (node, axle), angle in zip(self._wheels, state[WHEEL_ANGLES], strict=True):
            node.wxyz = np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axle)])

    def remove(self) -> None:
        """Takes the robot away."""
        self._root.remove()


def quaternion_of(rotation: FloatArray) -> tuple[float, float, float, float]:
    """`[w, x, y, z]` of a rotation matrix."""
    w, x, y, z = viser.transforms.SO3.from_matrix(rotation).wxyz
    return float(w), float(x), float(y), float(z)
