"""Commands of a task to the robots at one instant."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Asked:
    """The commands of all robots, and the metrics of robot 0 so far."""

    #: Name of the task.
    task: str
    #: Shape (n, k), parts as in `TASKS[task]["command"]`.
    commands: FloatArray
    #: Position of each ball when its command was given, m, shape (n, 2): a path begins there.
    begins: FloatArray
    #: Desired position of each ball now, m, shape (n, 2).
    points: FloatArray
    #: Last push of the task on each body, shape (n, 3): impulse (N·s), azimuth (rad), height; NaN without one.
    pushes: FloatArray
    #: Metrics of robot 0, by name; NaN where the episode is too short.
    metrics: Mapping[str, float]
    #: Whether the command came from the page.
    by_hand: bool
