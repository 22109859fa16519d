"""From logged commands to the torques of the model's steps: delay, strength and lag."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import ACTUATOR_OPTIONS, load_actuators
from ballbot_rs._errors import InvalidInputError

Array = npt.NDArray[np.float64]

#: Largest delay and lag that a fit tries, s.
MAX_DELAY: Final = 0.1
MAX_LAG: Final = 0.2
#: Limits of the options.
LIMITS: Final[Mapping[str, tuple[float, float]]] = {
    "delay": (0.0, MAX_DELAY),
    "lag": (0.0, MAX_LAG),
    "strength": (0.0, 10.0),
}


@dataclasses.dataclass(frozen=True)
class Motors:
    """The part of docs/actuators.md that can be fitted; the delay need not be a whole number of model steps."""

    #: s.
    delay: float = 0.0
    #: s.
    lag: float = 0.0
    #: Of each motor, as a fraction of the commanded torque.
    strength: tuple[float, ...] = (1.0, 1.0, 1.0)

    @classmethod
    def of(cls, actuators: Mapping[str, Any] | str | None) -> "Motors":
        """The motors of the option `actuators` of an environment.

        Raises:
            ValueError: an option that is unknown, out of range, or not supported by the fit.
        """
        if actuators is None:
            return cls()
        options: dict[str, Any] = dict(actuators if isinstance(actuators, Mapping) else load_actuators(actuators))
        own = [field.name for field in dataclasses.fields(cls)]
        defaults = {option["name"]: option["default"] for option in ACTUATOR_OPTIONS}
        for name, value in options.items():
            if name not in defaults:
                raise InvalidInputError(
                    f"unknown actuator option {name!r}: expected {', '.join(own)}{did_you_mean(name, own)}"
                )
            if name not in own and value != defaults[name]:
                raise InvalidInputError(
                    f"actuators: {name} = {value} is not supported by identification, which has {', '.join(own)}"
                )
        numbers = {name: _checked(name, options[name]) for name in own if name in options}
        strength = numbers.pop("strength", np.ones(1))
        return cls(
            **{name: float(value[0]) for name, value in numbers.items()},
            strength=tuple((strength * np.ones(3)).tolist()),
        )

    def torques(self, times: Array, commands: Array, sim_dt: float, steps: int, limit: float) -> Array:
        """Torque of each wheel in each model step after the first row, N·m, shape (steps, 3).

        A command holds from its row to the next row. A step has the mean of the delayed commands over its duration,
        which is the command itself where the rows and the delay are whole numbers of steps.

        Args:
            times: of the rows, s, shape (n,).
            commands: N·m, shape (n, 3).
            sim_dt: duration of a model step, s.
            steps: number of model steps.
            limit: of the torque's magnitude, N·m.
        """
        edges = times[0] + sim_dt * np.arange(steps + 1) - self.delay
        impulses = np.concatenate([np.zeros((1, 3)), np.cumsum(commands[:-1] * np.diff(times)[:, None], axis=0)])
        # Before the first row and after the last row their commands hold.
        span = 1.0 + MAX_DELAY + sim_dt * (steps + 1)
        times = np.concatenate([[times[0] - span], times, [times[-1] + span]])
        impulses = np.concatenate([impulses[:1] - span * commands[:1], impulses, impulses[-1:] + span * commands[-1:]])
        reached = np.stack([np.interp(edges, times, impulses[:, wheel]) for wheel in range(3)], axis=-1)
        torques: Array = np.diff(reached, axis=0) / sim_dt * np.array(self.strength)
        if self.lag > 0.0:
            from scipy.signal import lfilter

            share = -np.expm1(-sim_dt / self.lag)
            torques, _ = lfilter([share], [1.0, share - 1.0], torques, axis=0, zi=(1.0 - share) * torques[:1])
        return np.clip(torques, -limit, limit)


def _checked(name: str, value: Any) -> Array:
    """The numbers of an option, shape (1,) or (3,); an error names a number that is out of range."""
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if numbers.shape not in ((1,), (3,) if name == "strength" else (1,)):
        raise InvalidInputError(
            f"actuators: {name} has the shape {numbers.shape}, expected "
            f"{'1 or 3 numbers' if name == 'strength' else 'one number'}"
        )
    low, high = LIMITS[name]
    for number in numbers.tolist():
        if not low <= number <= high:
            raise InvalidInputError(
                f"actuators: {name} = {number:g} is out of range: it must be from {low:g} to {high:g}"
            )
    return numbers
