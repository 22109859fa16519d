"""The boundary that a control barrier keeps, on the floor."""

import numpy as np
import viser

from ballbot_rs.viewer.scene.arrows import closed_line
from ballbot_rs.viewer.session.recording import Frame

COLOR = (204, 56, 46)

#: Width of the line, m, and points along a side, which follow a terrain.
THICKNESS, SIDE = 0.012, 24


class BoundaryLine:
    """A rectangle."""

    def __init__(self, server: viser.ViserServer, name: str) -> None:
        self._line = server.scene.add_line_segments(
            name, np.zeros((1, 2, 3)), COLOR, thickness=THICKNESS, visible=False
        )
        self._shown: object = None

    def show(self, frame: Frame) -> None:
        """Draws the boundary of a frame."""
        if frame.boundary is None:
            if self._line.visible:
                self._line.visible = False
            return
        current = (tuple(frame.boundary), frame.terrain)
        if current != self._shown:
            self._shown = current
            left, right, near, far = frame.boundary
            corners = np.array([[left, near], [right, near], [right, far], [left, far]])
            steps = np.linspace(0.0, 1.0, SIDE, endpoint=False)[:, np.newaxis]
            sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            points = np.concatenate([a + steps * (b - a) for a, b in sides])
            self._line.points = np.float32(closed_line(points, frame.heights(points)))
        if not self._line.visible:
            self._line.visible = True
