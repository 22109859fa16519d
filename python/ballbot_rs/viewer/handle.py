"""Pulling robot 0 with the mouse: dragging stretches a spring from its center of mass to the pointer."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.session import Session


class PullHandle:
    """Makes a robot's meshes draggable.

    Args:
        submit: puts a command into the queue.
    """

    def __init__(self, submit: Callable[[Command], bool]) -> None:
        self._submit = submit

    def attach(self, node: viser.MeshHandle) -> None:
        """Makes one mesh draggable."""
        node.on_drag(self._dragged)

    def _dragged(self, event: viser.SceneNodeDragEvent[Any]) -> None:
        stretch = np.subtract(event.end_position, event.start_position)
        ends = event.phase == "end"

        def command(session: Session) -> None:
            if ends:
                session.pull(None)
            elif session.replay_time is None:
                session.pull(session.robots.com + stretch)

        self._submit(command)
