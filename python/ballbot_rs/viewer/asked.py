"""What a task asks of the robots at one instant."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Asked:
    """The commands of all robots, and how robot 0 has done so far."""

    #: Name of the task.
    task: str
    #: Shape (n, k), parts as in `TASKS[task]["command"]`.
    commands: FloatArray
    #: Where each ball was when its command was given, m, shape (n, 2): a path begins there.
    begins: FloatArray
    #: Where the task wants each ball now, m, shape (n, 2).
    points: FloatArray
    #: Last push of the task on each body, shape (n, 3): impulse (N·s), azimuth (rad), height; NaN without one.
    pushes: FloatArray
    #: Of robot 0, by name; NaN where the episode is too short for one.
    metrics: Mapping[str, float]
    #: Whether the command came from the page.
    by_hand: bool
