"""Pushes and forces on the body over time, as impulses at the starts of control steps."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_real, real_array
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named

#: Largest frequency of a force, Hz.
_MOST_HERTZ = 1e4

T = TypeVar("T")

Vector: TypeAlias = tuple[float, float, float]
#: An impulse, inertial frame, N·s, and its point, body frame, m, or None for the CoM.
Impulse: TypeAlias = tuple[Vector, Vector | None]


def half_sine(count: int) -> npt.NDArray[np.float64]:
    """Fractions of a half-sine impulse in `count` equal parts of its duration; they sum to one."""
    shares: npt.NDArray[np.float64] = np.sin((np.arange(count) + 0.5) * np.pi / count) * np.sin(0.5 * np.pi / count)
    return shares


@named
@dataclasses.dataclass(frozen=True)
class Push:
    """An impulse on the body at a time, at once or over a duration.

    ```python
    push = bb.Push((0.5, 0.0, 0.0), time=0.5, duration=0.1)
    print(bb.simulate("lqr", pushes=push, seconds=3.0))
    ```

    Over a duration the force is half a sine: zero at both ends, π/2 times the mean in the middle.
    """

    #: Inertial frame, N·s.
    impulse: Vector
    #: Start, s.
    time: float = 1.0
    #: s; 0 is an instantaneous impulse.
    duration: float = 0.0
    #: Body frame, m; None is the CoM of the body.
    point: Vector | None = None

    def share(self, begin: float, end: float) -> float:
        """Fraction of the impulse between two times, s."""
        if self.duration == 0.0:
            return float(begin <= self.time < end)
        angles = [math.pi * min(max((t - self.time) / self.duration, 0.0), 1.0) for t in (begin, end)]
        return 0.5 * (math.cos(angles[0]) - math.cos(angles[1]))


@named
@dataclasses.dataclass(frozen=True)
class Force:
    """A force on the body between two times: constant, or a sine that begins at zero.

    ```python
    wind = bb.Force((2.0, 0.0, 0.0), begin=0.5, end=1.5)
    print(bb.simulate("lqr", forces=wind, seconds=3.0))
    ```
    """

    #: Inertial frame, N; for a sine, its amplitude.
    force: Vector
    #: s.
    begin: float = 0.0
    #: s; None is the end of the simulation.
    end: float | None = None
    #: Body frame, m; None is the CoM of the body.
    point: Vector | None = None
    #: Of the sine, Hz; 0 is a constant force.
    frequency: float = 0.0

    def factor(self, time: float) -> float:
        """The force at a time, s, as a multiple of `force`."""
        if not self.begin <= time <= (math.inf if self.end is None else self.end):
            return 0.0
        return 1.0 if self.frequency == 0.0 else math.sin(2.0 * math.pi * self.frequency * (time - self.begin))

    def share(self, begin: float, end: float) -> float:
        """Integral of `factor` between two times, s."""
        first, last = (min(max(t, self.begin), math.inf if self.end is None else self.end) for t in (begin, end))
        if self.frequency == 0.0:
            return last - first
        turn = 2.0 * math.pi * self.frequency
        return (math.cos(turn * (first - self.begin)) - math.cos(turn * (last - self.begin))) / turn


def checked(
    pushes: Push | Sequence[Push], forces: Force | Sequence[Force], seconds: float
) -> tuple[tuple[Push, ...], tuple[Force, ...]]:
    """Pushes and forces on a simulation of a duration, one or several of each.

    Raises:
        TypeError: anything other than pushes and forces.
        ValueError: a number out of range.
    """
    several, constant = _several("pushes", pushes, Push), _several("forces", forces, Force)
    for push in several:
        _check_vectors("a push", push.impulse, push.point)
        time, duration = check_real("time of a push", push.time), check_real("duration of a push", push.duration)
        if not 0.0 <= time < seconds:
            limits = f"it must be at least 0 and before the end, {seconds} s"
            raise InvalidInputError(f"a push at {time} s is out of range: {limits}")
        if not 0.0 <= duration < math.inf:
            raise InvalidInputError(f"a push has duration = {duration}: it must be at least 0 and finite")
    for force in constant:
        _check_vectors("a force", force.force, force.point)
        begin = check_real("beginning of a force", force.begin)
        end = seconds if force.end is None else check_real("end of a force", force.end)
        if not 0.0 <= begin < min(end, seconds):
            limits = f"it must be at least 0 and before its end, {min(end, seconds)} s"
            raise InvalidInputError(f"a force begins at {begin} s: {limits}")
        frequency = check_real("frequency of a force", force.frequency)
        if not 0.0 <= frequency <= _MOST_HERTZ:
            raise InvalidInputError(f"a force has frequency = {frequency}: it must be from 0 to {_MOST_HERTZ} Hz")
    return several, constant


def _several(name: str, given: T | Sequence[T], kind: type[T]) -> tuple[T, ...]:
    if isinstance(given, kind):
        return (given,)
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise TypeError(f"{name} = {given!r}: expected a {kind.__name__} or a list of them")
    several = tuple(given)
    for one in several:
        if not isinstance(one, kind):
            raise TypeError(f"{name} has {one!r}: expected a {kind.__name__}")
    return several


def _check_vectors(what: str, vector: Any, point: Any) -> None:
    for value in (vector,) if point is None else (vector, point):
        numbers = real_array(f"{what} has", value, "three numbers")
        if numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise InvalidInputError(f"{what} has {value}: expected three finite numbers")


def impulses(
    pushes: Sequence[Push], forces: Sequence[Force], steps: int, control_dt: float
) -> Mapping[int, Sequence[Impulse]]:
    """Impulses by the number of the control step that starts with them.

    An instantaneous push goes to the step that starts nearest to its time; a push or force with a duration is divided
    over the steps that it overlaps.
    """
    found: dict[int, list[Impulse]] = {}

    def add(step: int, vector: Sequence[float], share: float, point: Vector | None) -> None:
        x, y, z = (share * float(value) for value in vector)
        found.setdefault(step, []).append(((x, y, z), point))

    for push in pushes:
        if push.duration == 0.0:
            add(min(round(push.time / control_dt), steps - 1), push.impulse, 1.0, push.point)
            continue
        spread = _steps(push.time, push.time + push.duration, steps, control_dt)
        if not spread:
            # It begins after the last whole step, as an instantaneous push may.
            add(steps - 1, push.impulse, 1.0, push.point)
        for step in spread:
            add(step, push.impulse, push.share(step * control_dt, (step + 1) * control_dt), push.point)
    for force in forces:
        end = math.inf if force.end is None else force.end
        for step in _steps(force.begin, end, steps, control_dt):
            share = force.share(step * control_dt, (step + 1) * control_dt)
            add(step, force.force, share, force.point)
    return found


def _steps(begin: float, end: float, steps: int, control_dt: float) -> range:
    """The control steps that overlap the span between two times, s."""
    last = steps if end == math.inf else min(math.ceil(end / control_dt), steps)
    return range(min(math.floor(begin / control_dt), steps), last)
