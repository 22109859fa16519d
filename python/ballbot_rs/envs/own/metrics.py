"""Metrics of tasks in Python: means over the steps of each robot's episode."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class EpisodeMeans:
    """Means of some numbers over the steps of an episode of each robot.

    Args:
        names: of the numbers.
        num_envs: number of robots.
    """

    def __init__(self, names: Sequence[str], num_envs: int) -> None:
        self.names = tuple(names)
        self._sums = np.zeros((num_envs, len(self.names)))
        self._counts = np.zeros(num_envs, dtype=np.int64)
        #: Robots in a new episode that has no step yet: their sums are of the last episode.
        self._begun = np.zeros(num_envs, dtype=bool)

    def begin(self, robots: npt.NDArray[np.intp]) -> None:
        """Some robots begin an episode."""
        self._begun[robots] = True

    def add(self, robots: npt.NDArray[np.intp], values: Mapping[str, FloatArray]) -> None:
        """Adds the values of a step of some robots, shape (n,) each."""
        fresh = robots[self._begun[robots]]
        self._sums[fresh], self._counts[fresh], self._begun[fresh] = 0.0, 0, False
        for column, name in enumerate(self.names):
            self._sums[robots, column] += values[name]
        self._counts[robots] += 1

    def last(self) -> FloatArray:
        """Of the episode of the last step, shape (num_envs, k); NaN before the first step."""
        with np.errstate(invalid="ignore"):
            means: FloatArray = self._sums / np.where(self._counts, self._counts, np.nan)[:, np.newaxis]
        return means

    def present(self) -> FloatArray:
        """Of the present episode, shape (num_envs, k); 0 before its first step."""
        return np.where(self._begun[:, np.newaxis] | ~np.isfinite(means := self.last()), 0.0, means)
