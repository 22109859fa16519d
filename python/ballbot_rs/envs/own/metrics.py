"""Metrics of tasks in Python, over the steps of each robot's episode."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError

FloatArray = npt.NDArray[np.float64]

#: What a metric of an episode may be, of its values in the steps.
SUMMARIES: Final = {
    "mean": "mean over the steps of an episode",
    "rms": "root mean square over the steps of an episode",
    "max": "largest of an episode",
    "min": "smallest of an episode",
    "last": "after the last step of an episode",
}


class EpisodeMetrics:
    """Some numbers, summarized over the steps of an episode of each robot.

    Args:
        names: of the numbers.
        num_envs: number of robots.
        summaries: keys of `SUMMARIES` by name; "mean" for other names.
    """

    def __init__(self, names: Sequence[str], num_envs: int, summaries: Mapping[str, str]) -> None:
        self.names = tuple(names)
        self.kinds = tuple(summaries.get(name, "mean") for name in self.names)
        self._is_mean = np.array([kind in ("mean", "rms") for kind in self.kinds])
        self._is_rms = np.array([kind == "rms" for kind in self.kinds])
        self._first = np.where(self._is_mean, 0.0, np.nan)
        self._held = np.tile(self._first, (num_envs, 1))
        self._counts = np.zeros(num_envs, dtype=np.int64)
        #: Robots in a new episode that has no step yet: what is held is of the last episode.
        self._begun = np.zeros(num_envs, dtype=bool)

    def begin(self, robots: npt.NDArray[np.intp]) -> None:
        """Some robots begin an episode."""
        self._begun[robots] = True

    def add(self, robots: npt.NDArray[np.intp], values: Mapping[str, FloatArray]) -> None:
        """Adds the values of a step of some robots, shape (n,) each."""
        fresh = robots[self._begun[robots]]
        self._held[fresh], self._counts[fresh], self._begun[fresh] = self._first, 0, False
        for column, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True)):
            value, held = values[name], self._held[robots, column]
            match kind:
                case "mean":
                    value = held + value
                case "rms":
                    value = held + value**2
                case "max":
                    value = np.fmax(held, value)
                case "min":
                    value = np.fmin(held, value)
            self._held[robots, column] = value
        self._counts[robots] += 1

    def last(self) -> FloatArray:
        """Of the episode of the last step, shape (num_envs, k); NaN before the first step."""
        counts = np.where(self._counts, self._counts, np.nan)[:, np.newaxis]
        found: FloatArray = np.where(self._is_mean, self._held / counts, self._held)
        return np.sqrt(found, out=found, where=self._is_rms)

    def present(self) -> FloatArray:
        """Of the present episode, shape (num_envs, k); 0 before its first step."""
        return np.where(self._begun[:, np.newaxis] | ~np.isfinite(found := self.last()), 0.0, found)


def check_declared(names: Sequence[str], summaries: object, units: object) -> None:
    """Checks what a task declares of its metrics with these names.

    Raises:
        TypeError: not a mapping.
        ValueError: a name without a metric, a summary of another kind, or a unit that is not text.
    """
    metrics = f"one of the metrics {', '.join(names)}" if names else "a metric, but metrics() returns none"
    of_kinds = ("summaries", summaries, tuple(SUMMARIES), f"one of {', '.join(SUMMARIES)}")
    for of, given, kinds, expected in (of_kinds, ("units", units, None, "text")):
        if not isinstance(given, Mapping):
            raise TypeError(f"{of} = {given!r}: expected a dict, {expected} by name of a metric")
        for name, value in given.items():
            if name not in names or not isinstance(value, str) or (kinds is not None and value not in kinds):
                raise InvalidInputError(f"{of} has {value!r} for {name!r}: expected {expected} for {metrics}")
