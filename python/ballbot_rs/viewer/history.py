"""The last seconds of robot 0, for plots."""

from collections import deque

import numpy as np
import numpy.typing as npt

from ballbot_rs._state_rows import BALL_POSITION, BALL_VELOCITY
from ballbot_rs.viewer.recording import Frame

FloatArray = npt.NDArray[np.float64]

#: Time span, s, and the least time between two samples, s.
SPAN = 10.0
PERIOD = 0.02

#: Rows of `History.series` by name.
SERIES: dict[str, slice] = {
    "time": slice(0, 1),
    "tilt": slice(1, 3),
    "torques": slice(3, 6),
    "loads": slice(6, 9),
    "slip": slice(9, 12),
    "utilization": slice(12, 16),
    "estimated tilt": slice(16, 18),
    "position": slice(18, 20),
    "speed": slice(20, 21),
}
ROWS = 21


class History:
    """Samples at most `SPAN` old."""

    def __init__(self) -> None:
        self._samples: deque[FloatArray] = deque(maxlen=round(SPAN / PERIOD))

    def add(self, frame: Frame) -> None:
        """Adds a sample unless it comes too soon; a sample from the past restarts the history."""
        if self._samples:
            elapsed = frame.time - self._samples[-1][0]
            if elapsed < 0.0:
                self.clear()
            elif elapsed < PERIOD * (1.0 - 1e-9):
                return
        estimated = np.full(2, np.nan) if frame.estimated_tilt is None else frame.estimated_tilt
        position, speed = frame.states[0, BALL_POSITION][:2], np.hypot(*frame.states[0, BALL_VELOCITY][:2])
        forces = (frame.torques[0], frame.loads, frame.slip, frame.utilization)
        parts = ([frame.time], frame.tilt, *forces, estimated, position, [speed])
        self._samples.append(np.concatenate(parts))

    def clear(self) -> None:
        """Removes all samples."""
        self._samples.clear()

    def series(self) -> FloatArray:
        """All samples, shape (21, n), rows as in `SERIES`; NaN where there was no estimate."""
        return np.array(self._samples).T if self._samples else np.empty((ROWS, 0))
