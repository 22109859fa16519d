"""Closed curves along which the setpoint of the task balance moves."""

import dataclasses
import math
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Names of the curves.
ROUTES: Final = ("circle", "eight")

#: Radius of the circle, m, and half the length of the figure eight, m, which is twice as long as it is wide.
RADIUS: Final = 0.5
HALF_LENGTH: Final = 0.7

#: Largest speed of the setpoint, m/s.
MAX_SPEED: Final = 0.3

#: Points of a curve.
SAMPLES: Final = 128


@dataclasses.dataclass(frozen=True)
class Route:
    """A curve through a point, m, with a largest speed of the setpoint on it, m/s."""

    name: str
    begin: tuple[float, float]
    speed: float

    def __post_init__(self) -> None:
        if self.name not in ROUTES:
            raise ValueError(f"unknown route '{self.name}': expected one of {', '.join(ROUTES)}")
        if not 0.0 < self.speed <= MAX_SPEED:
            raise ValueError(f"speed = {self.speed} is out of range: expected above 0 to {MAX_SPEED:g}")

    def at(self, seconds: float) -> FloatArray:
        """The setpoint at a time after the start, m."""
        # The figure eight is fastest at its crossing: √2 times its half length per radian.
        reach = RADIUS if self.name == "circle" else HALF_LENGTH * math.sqrt(2.0)
        return self._point(self.speed * seconds / reach)

    def curve(self) -> FloatArray:
        """Points of the whole curve, m, shape (n, 2)."""
        return np.array([self._point(2.0 * math.pi * i / SAMPLES) for i in range(SAMPLES)])

    def _point(self, phase: float) -> FloatArray:
        if self.name == "circle":
            offset = (RADIUS * math.sin(phase), RADIUS * (1.0 - math.cos(phase)))
        else:
            offset = (HALF_LENGTH * math.sin(phase), 0.5 * HALF_LENGTH * math.sin(2.0 * phase))
        return np.asarray(self.begin) + offset
