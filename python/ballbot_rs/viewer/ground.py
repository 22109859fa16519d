"""The ground of a session, and its intersection with a ray."""

from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import TASKS, Params, Terrain
from ballbot_rs.envs._batch_env import new_batch

#: Sample distances along a ray, m: in steps smaller than a ball, and geometric farther away.
WAYS = np.concatenate([np.arange(0.0, 10.0, 0.02), np.geomspace(10.0, 1000.0, 2304)])


class Grounds:
    """Makes the ground, and keeps the last: large terrains take a second."""

    def __init__(self) -> None:
        self._key: Any = None
        self._made: Terrain | None = None

    def of(self, task: str, params: Params, given: Any) -> Terrain | None:
        """The ground of a robot in a task; None is level.

        Args:
            task: its name; some tasks have their own ground, which depends on the robot.
            params: the robot.
            given: the option `terrain` of an environment; None is the task's own.

        Raises:
            ValueError: invalid ground, or the robot cannot be on it.
        """
        if given is None and not TASKS[task]["has_terrain"]:
            return None
        key = (task, params, given)
        if self._key is None or any(a is not b and a != b for a, b in zip(key, self._key, strict=True)):
            options = {"params": params, "terrain": given}
            self._made = new_batch(1, task=task, num_threads=1, options=options).terrain
            self._key = key
        return self._made


def ray_meets(
    terrain: Terrain | None, origin: npt.NDArray[np.float64], direction: npt.NDArray[np.float64]
) -> tuple[float, float] | None:
    """The first intersection (x, y) of a ray with the ground, m; None if there is none."""
    if terrain is None:
        if origin[2] <= 0.0 or direction[2] > -1e-6:
            return None
        x, y, _ = origin - origin[2] / direction[2] * direction
        return float(x), float(y)
    points = origin + WAYS[:, np.newaxis] * direction / np.linalg.norm(direction)
    gaps = points[:, 2] - np.asarray(terrain.height(points[:, 0], points[:, 1]))
    below = np.flatnonzero(gaps < 0.0)
    if not len(below) or below[0] == 0:
        return None
    last, first = below[0] - 1, below[0]
    share = gaps[last] / (gaps[last] - gaps[first])
    x, y, _ = points[last] + share * (points[first] - points[last])
    return float(x), float(y)
