"""The handle by which robot 0 is pulled with the mouse.

What viser offers is a gizmo that reports where it was dragged to, but neither the beginning nor the end of a drag. So
the handle stays on the robot's center of mass; once it is moved, it pulls the robot towards itself as a spring does,
and when it has rested for `HOLD` it lets go and returns to the robot.
"""

import time
from collections.abc import Callable

import numpy as np
import viser

from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.scene import WORLD
from ballbot_rs.viewer.session import Session

#: How long the handle pulls after its last move, s.
HOLD = 0.4


class PullHandle:
    """A gizmo on robot 0, hidden in a replay."""

    def __init__(self, server: viser.ViserServer, submit: Callable[[Command], bool]) -> None:
        self._gizmo = server.scene.add_transform_controls(
            f"{WORLD}/pull", scale=0.25, disable_rotations=True, disable_sliders=True, depth_test=False
        )
        self._submit = submit
        self._moved = -np.inf
        self._gizmo.on_update(self._dragged)

    def _dragged(self, gizmo: viser.TransformControlsHandle) -> None:
        target = np.array(gizmo.position)

        def command(session: Session) -> None:
            session.pull(target)
            self._moved = time.perf_counter()

        self._submit(command)

    def show(self, session: Session) -> None:
        """Puts the handle on the robot unless it is being dragged."""
        if session.pull_point is not None and time.perf_counter() - self._moved > HOLD:
            session.pull(None)
        if session.pull_point is None:
            self._gizmo.position = session.robots.com
        self._gizmo.visible = session.replay_time is None
