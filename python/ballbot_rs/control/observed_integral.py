"""Integral action in what a policy observes (the option `integral_rate`), for observations made one by one."""

from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Batch
from ballbot_rs.envs.registration import description_of

#: The rows of the position error and of the velocity.
POSITION: Final = tuple(f"ball position from the setpoint, heading {axis}" for axis in "xy")
VELOCITY: Final = tuple(f"ball velocity, heading {axis}" for axis in "xy")


class ObservedIntegral:
    """Adds the integral of the position error to the observations of one robot, and limits it, as its environment does.

    Args:
        batch: whose integral it is; without `integral_rate` observations, of a batch without it, stay as they are.
    """

    def __init__(self, batch: Batch) -> None:
        self._numbers = batch.integral
        if self._numbers is not None:
            names = [row["name"] for row in description_of(batch.task)["observation"]]
            self._position, self._velocity = ([names.index(name) for name in of] for of in (POSITION, VELOCITY))
        self._value: npt.NDArray[np.float64] | None = None

    def add(self, observation: npt.NDArray[np.float32]) -> None:
        """Adds it to the rows of the next observation, in place."""
        if self._numbers is None:
            return
        error, velocity = (observation[rows].astype(np.float64) for rows in (self._position, self._velocity))
        if self._value is None:
            self._value = np.zeros(2)
        else:
            share = self._numbers["rate"] / (1.0 + np.square(velocity / self._numbers["slow"]).sum())
            self._value = self._within(self._value + self._within(error, "largest_error") * share, "largest")
        observation[self._position] = self._within(error + self._value, "largest_shown")

    def _within(self, vector: npt.NDArray[np.float64], limit: str) -> npt.NDArray[np.float64]:
        assert self._numbers is not None
        return vector * min(1.0, self._numbers[limit] / max(float(np.linalg.norm(vector)), 1e-9))

    def reset(self) -> None:
        """Forgets the integral."""
        self._value = None
