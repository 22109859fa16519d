"""Feedback laws on robots: how they are called, and what they may return.

A law of one robot is called as `law(state)`, `law(state, setpoint)` or `law(state, position=...)` and returns three
wheel torques, N·m. A batched law has the attribute `batched = True` and is called once for all robots, as
`law(states)` or `law(states, setpoints)`: states of shape (n, 32), rows as `State.to_array`, and a dict of arrays by
the parts of a setpoint, shape (n, 2) or (n,); it returns torques of shape (n, 3).

A law with the attribute `reads_sensors = True` is called with the last readings of the sensors in place of the state, a
dict as `Batch.readings`.
"""

import copy
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import real_array
from ballbot_rs._core import Controller
from ballbot_rs._errors import ControllerError, InvalidInputError
from ballbot_rs.control.setpoints import PARTS, Setpoint

Array = npt.NDArray[np.float64]

_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
_PLACED = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


class Law(Protocol):
    """A feedback law in one of the forms above; `name`, `control_dt` (s) and `reset` are optional.

    `reset()` clears its memory; a batched law has `reset(mask)`, which clears the memory of some robots, shape (n,),
    bool.
    """

    def __call__(self, *arguments: Any, **parts: Any) -> npt.ArrayLike:
        """Wheel torques for the next control step."""


def is_batched(law: Any) -> bool:
    """Whether a law is called once for all robots."""
    return bool(getattr(law, "batched", False))


def reads_sensors(law: Any) -> bool:
    """Whether a law is called with readings of sensors in place of a state."""
    return bool(getattr(law, "reads_sensors", False))


def followed_parts(law: Any) -> tuple[str, ...]:
    """The parts of a setpoint that a law follows."""
    if isinstance(law, Controller):
        return tuple(law.setpoint_parts)
    return tuple(PARTS) if _takes_setpoint(law) else _part_names(law)


def takes_position(law: Any) -> bool:
    """Whether a feedback law follows a position."""
    return "position" in followed_parts(law)


def parts_for(name: str, followed: Sequence[str], parts: Mapping[str, Any]) -> dict[str, Any]:
    """The parts of a setpoint that a law follows, so that one reference can go to all laws.

    Raises:
        TypeError: it follows none of them.
    """
    taken = {part: value for part, value in parts.items() if part in followed}
    if parts and not taken:
        what = f"it follows {', '.join(followed)}" if followed else "it takes no setpoint"
        raise TypeError(f"{name} does not follow {', '.join(parts)} of a setpoint: {what}")
    return taken


def _parameters(law: Any) -> list[inspect.Parameter]:
    try:
        return list(inspect.signature(law).parameters.values())
    except (TypeError, ValueError):
        return []


def _part_names(law: Any) -> tuple[str, ...]:
    """The parts that are separate arguments."""
    return tuple(p.name for p in _parameters(law) if p.name in PARTS and p.kind in _NAMED)


def _takes_setpoint(law: Any) -> bool:
    """Whether the second argument is a setpoint: it is named so, or it has no default and not the name of a part."""
    placed = [p for p in _parameters(law) if p.kind in _PLACED]
    if len(placed) < 2 or (placed[1].name in PARTS and placed[1].kind in _NAMED):
        return False
    return placed[1].name in ("setpoint", "setpoints") or placed[1].default is inspect.Parameter.empty


class Laws:
    """A feedback law on each of `count` robots. Torques beyond the limit are scaled down together.

    Clipping each of them would change their direction.

    Args:
        name: of the law, for errors.
        make: makes the law, or returns the existing law.
        count: number of robots.
        max_torque: limit of a wheel torque, N·m.
        is_made: whether `make` makes another law at each call; else robots beyond the first have copies.

    Raises:
        TypeError: an object that cannot be copied, for more than one robot.
    """

    def __init__(
        self, name: str, make: Callable[[], Any], count: int, max_torque: float, *, is_made: bool = True
    ) -> None:
        self.name = name
        self._make, self._count, self._max_torque, self._is_made = make, count, max_torque, is_made
        self.reset()
        self.is_batched = is_batched(self._laws[0])
        self.reads_sensors = reads_sensors(self._laws[0])
        self.follows = followed_parts(self._laws[0])
        self._call = self._form(self._laws[0])

    @property
    def first(self) -> Any:
        """The law of the first robot."""
        return self._laws[0]

    def torques(self, states: Array | Sequence[Any] | Mapping[str, Array], setpoints: Sequence[Setpoint]) -> Array:
        """Wheel torques for the next control step, shape (n, 3), N·m; arguments and other errors as of `desired`.

        Raises:
            ValueError: torques that are not finite.
        """
        torques = self.desired(states, setpoints)
        if not np.isfinite(torques).all():
            robot = int(np.flatnonzero(~np.isfinite(torques).all(axis=1))[0])
            raise InvalidInputError(f"{self.name} gave the torques {torques[robot]} N·m: they must be finite")
        scale = np.maximum(np.abs(torques).max(axis=1, keepdims=True) / self._max_torque, 1.0)
        limited: Array = torques / scale
        return limited

    def desired(self, states: Array | Sequence[Any] | Mapping[str, Array], setpoints: Sequence[Setpoint]) -> Array:
        """Wheel torques as the law gives them, shape (n, 3), N·m.

        Args:
            states: of all robots, or the readings of a law that reads sensors; for a batched law also an array, shape
                (n, 32).
            setpoints: one per robot.

        Raises:
            ControllerError: a law in Python failed.
            ValueError: torques of a wrong shape.
            TypeError: torques that are not numbers.
        """
        if self.is_batched:
            rows: Any = states
            if not isinstance(states, (np.ndarray, Mapping)):
                rows = np.array([state.to_array() for state in states])
            parts = {part: np.array([setpoint[part] for setpoint in setpoints]) for part in PARTS}
            torques = self._numbers(self._answer(self._laws[0], rows, parts), (len(setpoints), 3))
        else:
            answers = [
                self._numbers(self._answer(law, state, setpoint), (3,))
                for law, state, setpoint in zip(self._laws, states, setpoints, strict=True)
            ]
            torques = np.array(answers)
        return torques

    def reset(self, mask: npt.NDArray[np.bool_] | None = None) -> None:
        """Forgets the past of all robots, or of those in a mask, shape (n,)."""
        if mask is None:
            first = self._make()
            if is_batched(first):
                self._laws = [first]
                self._reset_batched(np.ones(self._count, dtype=bool))
            elif self._is_made:
                self._laws = [first, *(self._make() for _ in range(self._count - 1))]
            else:
                self._laws = [first, *self._copies(first)]
        elif self.is_batched:
            self._reset_batched(mask)
        else:
            for robot in np.flatnonzero(mask):
                if self._is_made:
                    self._laws[robot] = self._make()
                elif hasattr(self._laws[robot], "reset"):
                    self._laws[robot].reset()

    def _copies(self, first: Any) -> list[Any]:
        """Copies of an object, so that robots do not share memory."""
        try:
            return [copy.deepcopy(first) for _ in range(self._count - 1)]
        except Exception as error:
            raise TypeError(f"{self.name} cannot be copied for {self._count} robots: {error}") from error

    def _reset_batched(self, mask: npt.NDArray[np.bool_]) -> None:
        if hasattr(self._laws[0], "reset"):
            try:
                self._laws[0].reset(mask)
            except Exception as error:
                raise failed(self.name, error) from error

    def _form(self, law: Any) -> Callable[[Any, Any, Any], Any]:
        """How the law is called with a state and a setpoint."""
        if not isinstance(law, Controller) and _takes_setpoint(law):
            return _with_setpoint
        names = [part for part in self.follows if part in PARTS]
        return lambda law, state, setpoint: law(state, **{name: setpoint[name] for name in names})

    def _answer(self, law: Any, state: Any, setpoint: Any) -> Any:
        try:
            return self._call(law, state, setpoint)
        except Exception as error:
            if isinstance(law, Controller):
                raise
            raise failed(self.name, error) from error

    def _numbers(self, answer: Any, shape: tuple[int, ...]) -> Array:
        desired = f"wheel torques of shape {shape}, N·m"
        torques = real_array(f"{self.name} gave", answer, desired).astype(np.float64, copy=False)
        if torques.shape != shape:
            raise InvalidInputError(f"{self.name} gave torques of shape {torques.shape}: expected {shape}, N·m")
        return torques


def failed(name: str, error: Exception) -> ControllerError:
    """The error of a law in Python, with its name."""
    return ControllerError(f"{name} failed: {type(error).__name__}: {error}")


def _with_setpoint(law: Any, state: Any, setpoint: Any) -> Any:
    return law(state, setpoint)
