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
        batch: a batch whose observations have no past; without `integral_rate` they stay as they are.
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
            largest_error, largest = self._numbers["largest_error"], self._numbers["largest"]
            share = self._numbers["rate"] / (1.0 + np.square(velocity / self._numbers["slow"]).sum())
            step = np.clip(error, -largest_error, largest_error) * share
            self._value = np.clip(self._value + step, -largest, largest)
        shown = error + self._value
        distance = float(np.linalg.norm(shown))
        observation[self._position] = shown * min(1.0, self._numbers["largest_shown"] / max(distance, 1e-9))

    def reset(self) -> None:
        """Forgets the integral."""
        self._value = None
