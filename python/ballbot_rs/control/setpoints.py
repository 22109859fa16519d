"""Setpoints as laws in Python get them: desired ball position and heading, with their derivatives."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean, real_array
from ballbot_rs._errors import InvalidInputError

Array = npt.NDArray[np.float64]

#: How many numbers each part of a setpoint from a `Reference` has, by name; 1 is a float.
PARTS: Final[Mapping[str, int]] = {
    "position": 2,
    "velocity": 2,
    "acceleration": 2,
    "jerk": 2,
    "snap": 2,
    "yaw": 1,
    "yaw_rate": 1,
}
#: The same with the tilt, which pure tilt controllers follow.
ALL_PARTS: Final[Mapping[str, int]] = {**PARTS, "tilt": 2}


@dataclasses.dataclass(frozen=True, eq=False)
class Setpoint(Mapping[str, Any]):
    """The setpoint of a law, with attributes and as a mapping of the same names; arrays are read-only.

    ```python
    setpoint = bb.Setpoint(position=(0.5, 0.0), yaw=0.3)
    print(setpoint.position, setpoint["yaw"])
    ```

    Raises:
        ValueError: a wrong shape, or a number that is not finite.
    """

    #: Of the ball, inertial frame, shape (2,), m.
    position: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    #: m/s.
    velocity: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    #: Of the flat output, inertial frame, m/s², and its derivatives.
    acceleration: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    jerk: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    snap: Array = dataclasses.field(default_factory=lambda: np.zeros(2))
    #: Heading, rad.
    yaw: float = 0.0
    #: rad/s.
    yaw_rate: float = 0.0

    def __post_init__(self) -> None:
        for name, value in checked({name: getattr(self, name) for name in PARTS}).items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __getitem__(self, name: str) -> Any:
        if name not in PARTS:
            raise KeyError(name)
        return getattr(self, name)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mapping):
            return NotImplemented
        return self.keys() == other.keys() and all(np.array_equal(value, other[name]) for name, value in self.items())

    __hash__ = None  # type: ignore[assignment]

    def __iter__(self) -> Iterator[str]:
        return iter(PARTS)

    def __len__(self) -> int:
        return len(PARTS)


def checked(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Copies of the parts of a setpoint: arrays of shape (2,), and floats.

    Raises:
        ValueError: an unknown part, a wrong shape, or a number that is not finite.
        TypeError: not numbers.
    """
    found: dict[str, Any] = {}
    for name, value in parts.items():
        if name not in ALL_PARTS:
            known = f"expected one of {', '.join(ALL_PARTS)}{did_you_mean(name, ALL_PARTS)}"
            raise InvalidInputError(f"a setpoint has no part '{name}': {known}")
        numbers = real_array(f"the part {name} of a setpoint is", value, "numbers").astype(np.float64)
        shape = () if ALL_PARTS[name] == 1 else (ALL_PARTS[name],)
        if numbers.shape != shape:
            raise InvalidInputError(f"the part {name} of a setpoint has the shape {numbers.shape}, expected {shape}")
        if not np.isfinite(numbers).all():
            raise InvalidInputError(f"the part {name} of a setpoint is {value}: it must be finite")
        found[name] = numbers if shape else float(numbers)
    return found
