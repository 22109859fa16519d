"""Scenarios as data: disturbances and motions of a robot, and the criteria of success."""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final, get_type_hints

from ballbot_rs import _toml
from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._reading import read_regular
from ballbot_rs.analysis.settling import HOLD
from ballbot_rs.scenarios.metrics import METRICS

#: Numbers of an axis: one, or the first, the last and the step.
Axis = float | tuple[float, float, float]


#: Motions: constructors of `Reference`, and random velocities.
KINDS: Final = (
    "hold",
    "line",
    "path",
    "stops",
    "square",
    "velocities",
    "circle",
    "lemniscate",
    "attitude",
    "random_velocities",
)

#: Metrics that may be a score: smaller is better.
SCORES: Final = tuple(name for name in METRICS if name not in ("fell", "least_load"))

#: Largest frequency of a force, Hz.
_MOST_HERTZ: Final = 1e3

#: Largest distance to the point of a push, m.
_FARTHEST: Final = 10.0

#: Most numbers of a map, and the shortest time between pushes, s.
_MOST_NUMBERS: Final = 1000
_SHORTEST: Final = 0.01

#: Numbers of the motion `random_velocities`.
_RANDOM: Final = ("largest", "every", "change", "yaw_rate")

#: Largest file of scenarios, bytes.
MAX_SCENARIO_FILE: Final = 1 << 20


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _are_numbers(value: object, count: int) -> bool:
    return isinstance(value, tuple) and len(value) == count and all(map(_is_number, value))


def _is_whole(value: object) -> bool:
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def _is_table(value: object) -> bool:
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


#: Allowed values of a field by type, in words.
_EXPECTED: Final[Mapping[Any, tuple[str, Callable[[object], bool]]]] = {
    str: ("text", lambda value: isinstance(value, str)),
    int: ("a whole number", _is_whole),
    float: ("a finite number", _is_number),
    Axis: ("a finite number or three of them", lambda value: _is_number(value) or _are_numbers(value, 3)),
    float | None: ("a finite number", lambda value: value is None or _is_number(value)),
    tuple[float, float] | None: ("two finite numbers", lambda value: value is None or _are_numbers(value, 2)),
    Mapping[str, Any]: ("a table", _is_table),
    str | None: ("text", lambda value: value is None or isinstance(value, str)),
}


@named
@dataclasses.dataclass(frozen=True)
class Scenario:
    """A scenario; numbers are for the paper's robot, and `Scale` scales them for others.

    ```python
    leaning = bb.Scenario("lean", "Release at 5 deg", seconds=2.0, tilt=5.0, directions=4, score="rms_tilt")
    print(bb.run_scenarios(["lqr", "lqi"], leaning))
    ```

    Disturbances have `directions`, evenly spaced. A triple (first, last, step) of `tilt` or `push` makes a map: the
    largest number up to which all succeed, in each direction. Success in a map also requires recovery: the tilt stays
    within `final_tilt` from some time to the end, for at least 1 s. With enough `seconds` the map does not depend on
    them.
    """

    id: str
    title: str
    #: Simulated time, s.
    seconds: float
    #: The number by which controllers are compared, of `metrics.METRICS`.
    score: str
    #: Time from which errors are measured, s.
    measure_from: float = 0.0
    #: Initial tilt from the equilibrium, deg.
    tilt: Axis = 0.0
    #: Initial tilt rate in that direction, in units of the rate at which the robot topples from this tilt.
    tilt_rate: float = 0.0
    #: Impulse, N·s.
    push: Axis = 0.0
    #: Height of its point on the mast above the center of the ball, m; None is the height of the center of mass.
    push_height: float | None = None
    #: Distance of its point to the left of the mast, seen along the first push, m: the push turns the robot.
    push_arm: float = 0.0
    #: Start time, s.
    push_time: float = 0.0
    #: Duration of the half sine, s; 0 is instantaneous.
    push_duration: float = 0.0
    #: Range of the time between pushes at random times in random directions, s; empty is none.
    push_every: tuple[float, float] | None = None
    #: Horizontal force at the center of mass, N, and when it acts, s.
    force: float = 0.0
    force_from: float = 0.0
    force_until: float = 1e9
    #: Frequency of a sine of that amplitude, Hz; 0 is a constant force.
    force_frequency: float = 0.0
    #: Slope of the floor, deg.
    slope: float = 0.0
    #: Offset of the true center of mass from the mast, mm; the controller is made for the nominal robot.
    com_offset: float = 0.0
    #: Directions of tilts, pushes, forces, slopes and offsets.
    directions: int = 1
    #: The motion to follow: the name of a constructor of `Reference` as `kind`, and its arguments. Times are scaled.
    reference: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: A setpoint step of the position, m.
    step: float = 0.0
    #: Friction coefficient of the wheels in place of the robot's; the controller is made for it.
    friction: float | None = None
    #: Relative half width of the uniform distribution of the true mass, CoM height and inertia; corners and samples.
    model_error: float = 0.0
    #: Options of the motors.
    actuators: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: Name of a set of sensors; controllers then see the estimate.
    sensors: str | None = None
    #: Name of a set of events.
    events: str | None = None
    #: Number of episodes with different random numbers.
    seeds: int = 1
    #: Largest final tilt of a success, deg; None is 2, or any where a motion does not end.
    final_tilt: float | None = None
    #: Largest final distance (m) and speed (m/s) of a success.
    final_distance: float = 1e9
    final_speed: float = 1e9
    #: Largest final deviation of the heading of a success, deg.
    final_yaw: float = 180.0
    #: Tilt that counts as a fall, deg.
    fall_tilt: float = 57.3

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, list):
                value = tuple(value)
                object.__setattr__(self, field.name, value)
            words, fits = _EXPECTED[types()[field.name]]
            if not fits(value):
                shown = f"{field.name} = {reprlib.repr(value)}"
                raise InvalidInputError(
                    f"scenario {self.id if isinstance(self.id, str) else '?'}: {shown}, expected {words}"
                )
        for name, least, most in (("seconds", 0.02, 3600.0), ("directions", 1, 360), ("seeds", 1, 10_000)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"scenario {self.id}: {name} = {getattr(self, name)}, expected from {least} to {most}")
        if not 0.0 <= self.measure_from < self.seconds:
            limit = f"expected from 0 to before seconds = {self.seconds}"
            raise ValueError(f"scenario {self.id}: measure_from = {self.measure_from}, {limit}")
        for name in ("push_time", "push_duration", "force_from", "force_until"):
            if getattr(self, name) < 0.0:
                raise InvalidInputError(f"scenario {self.id}: {name} = {getattr(self, name)}, expected at least 0 s")
        if not 0.0 <= self.force_frequency <= _MOST_HERTZ:
            expected = f"expected from 0 to {_MOST_HERTZ:g} Hz"
            raise InvalidInputError(f"scenario {self.id}: force_frequency = {self.force_frequency}, {expected}")
        if self.push_every is not None and not _SHORTEST <= self.push_every[0] <= self.push_every[1]:
            expected = f"expected two times, the first at least {_SHORTEST} s and at most the second"
            raise InvalidInputError(f"scenario {self.id}: push_every = {self.push_every}, {expected}")
        for name in ("tilt", "push"):
            self._check_axis(name)
        for name in ("push_height", "push_arm"):
            value = getattr(self, name)
            if value is not None and abs(value) > _FARTHEST:
                raise ValueError(f"scenario {self.id}: {name} = {value}, expected a number within ±{_FARTHEST:g} m")
        if self.reference and self.reference.get("kind") not in KINDS:
            given = self.reference.get("kind")
            raise ValueError(f"scenario {self.id}: reference.kind = {given!r}, expected one of {', '.join(KINDS)}")
        if self.reference.get("kind") == "random_velocities":
            wrong = [name for name in _RANDOM if not _is_number(self.reference.get(name))]
            if wrong or self.reference["every"] < _SHORTEST:
                needs = f"the numbers {', '.join(_RANDOM)}, every at least {_SHORTEST} s"
                raise InvalidInputError(f"scenario {self.id}: reference = {dict(self.reference)}, expected {needs}")
        if self.score not in (*SCORES, "map", "success") or self.is_map != (self.score == "map"):
            expected = "map, as for every map" if self.is_map else f"success, {', '.join(SCORES)}"
            raise ValueError(f"scenario {self.id}: score = '{self.score}', expected {expected}")
        if self.is_map and self.seconds <= HOLD:
            raise ValueError(f"scenario {self.id}: seconds = {self.seconds}, a map needs more than {HOLD:g}")
        if isinstance(self.tilt, tuple) and isinstance(self.push, tuple):
            raise ValueError(f"scenario {self.id}: only one of tilt and push can be a map")

    def _check_axis(self, name: str) -> None:
        """One number, or the first, the last and the step of increasing numbers."""
        axis = getattr(self, name)
        if isinstance(axis, tuple) and not (axis[0] <= axis[1] and axis[2] > 0.0):
            raise ValueError(f"scenario {self.id}: {name} = {axis}, expected (first, last, step) with a step above 0")
        if isinstance(axis, tuple) and (axis[1] - axis[0]) / axis[2] > _MOST_NUMBERS:
            limit = f"expected at most {_MOST_NUMBERS} steps"
            raise InvalidInputError(f"scenario {self.id}: {name} = {axis}, {limit}")

    @property
    def moves(self) -> bool:
        """Whether the ball is commanded to move."""
        return bool(self.reference) or self.step != 0.0

    @property
    def is_map(self) -> bool:
        """Whether it finds the largest tilt or push."""
        return isinstance(self.tilt, tuple) or isinstance(self.push, tuple)


@cache
def types() -> Mapping[str, Any]:
    """Types of the fields of a scenario by name."""
    return get_type_hints(Scenario)


def load(path: str | Path | None = None) -> dict[str, Scenario]:
    """The scenarios of a TOML file, a list of tables `scenario`, by their id; None are the package's scenarios.

    ```python
    for name, scenario in bb.load_scenarios().items():
        print(name, scenario.title)
    ```

    Raises:
        ValueError: malformed TOML, an unknown or missing field, a value of the wrong kind, or a number out of range;
            the message has the file and the field.
        OSError: the file cannot be read.
    """
    if path is None:
        return dict(_shipped())
    try:
        return _parsed(read_regular(Path(path), MAX_SCENARIO_FILE).decode("utf-8"))
    except ValueError as error:
        raise InvalidInputError(f"{path}: {error}") from error


@cache
def _shipped() -> dict[str, Scenario]:
    text = resources.files("ballbot_rs.scenarios").joinpath("scenarios.toml").read_text(encoding="utf-8")
    return _parsed(text)


def _parsed(text: str) -> dict[str, Scenario]:
    content = _toml.loads(text)
    tables = content.pop("scenario", [])
    if content:
        raise ValueError(f"'{next(iter(content))}' is not known, expected only tables [[scenario]]")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ValueError(f"scenario = {reprlib.repr(tables)}, expected tables [[scenario]]")
    if not tables:
        raise ValueError("there is no [[scenario]]")
    fields = [field.name for field in dataclasses.fields(Scenario)]
    parameters = inspect.signature(Scenario).parameters.values()
    required = [parameter.name for parameter in parameters if parameter.default is parameter.empty]
    found: dict[str, Scenario] = {}
    for table in tables:
        name = table["id"] if isinstance(table.get("id"), str) else reprlib.repr(table.get("id"))
        for key in table:
            if key not in fields:
                raise ValueError(f"scenario {name} has no field '{key}'{did_you_mean(key, fields)}")
        if missing := [key for key in required if key not in table]:
            raise ValueError(f"scenario {name} lacks {', '.join(missing)}")
        one = Scenario(**table)
        if one.id in found:
            raise ValueError(f"there are two scenarios {name}")
        found[one.id] = one
    return found


def select(names: Sequence[str], known: Mapping[str, Scenario]) -> list[Scenario]:
    """Scenarios by id, or by the prefix before a dash: `S13` names `S13-6s` and all others of S13.

    Raises:
        ValueError: a name without a match.
    """
    if not names:
        return list(known.values())
    found: dict[str, Scenario] = {}
    for name in names:
        fitting = {key: one for key, one in known.items() if key == name or key.split("-")[0] == name}
        if not fitting:
            raise ValueError(
                f"unknown scenario '{name}': expected one of {', '.join(known)}{did_you_mean(name, known)}"
            )
        found.update(fitting)
    return list(found.values())
