"""Scenarios as data: what happens to a robot, what it is to do, and what counts as success."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _toml
from ballbot_rs._checks import did_you_mean
from ballbot_rs.analysis.settling import HOLD
from ballbot_rs.scenarios.metrics import METRICS

#: Numbers of an axis: one, or the first, the last and the step.
Axis = float | tuple[float, float, float]


#: Motions: constructors of `Reference`, and velocities at random.
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

#: Metrics that may be a score: less of them is better.
SCORES: Final = tuple(name for name in METRICS if name not in ("fell", "least_load"))

#: Largest distance of the point of a push, m.
_FARTHEST: Final = 10.0


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A scenario; numbers are those for the paper's robot, and are scaled for others by `Scale`.

    Disturbances have `directions`, evenly around. A triple (first, last, step) of `tilt` or `push` makes a map: the
    largest number up to which all succeed, in each direction. A success of a map must also have recovered: its tilt is
    within `final_tilt` from some time on to the end, for at least 1 s. Enough `seconds` make the map independent of
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
    #: First tilt from the equilibrium, deg.
    tilt: Axis = 0.0
    #: First tilt rate in that direction, in units of the rate at which the robot topples from this tilt.
    tilt_rate: float = 0.0
    #: Impulse, N·s.
    push: Axis = 0.0
    #: Height of its point on the mast above the center of the ball, m; None is that of the center of mass.
    push_height: float | None = None
    #: How far to the left of the mast its point is, seen along the first push, m: the push turns the robot.
    push_arm: float = 0.0
    #: When it begins, s.
    push_time: float = 0.0
    #: How long it lasts, along a half sine, s; 0 is at once.
    push_duration: float = 0.0
    #: Time between pushes at random times in random directions, from and to, s; none without.
    push_every: tuple[float, float] | None = None
    #: Horizontal force at the center of mass, N, and when it acts, s.
    force: float = 0.0
    force_from: float = 0.0
    force_until: float = 1e9
    #: Slope of the floor, deg.
    slope: float = 0.0
    #: Place of the true center of mass off the mast, mm; the controller is made for the nominal robot.
    com_offset: float = 0.0
    #: Directions of tilts, pushes, forces, slopes and offsets.
    directions: int = 1
    #: The motion to follow: the name of a constructor of `Reference` as `kind`, and its arguments. Times are scaled.
    reference: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: A position that is asked for at once, m.
    step: float = 0.0
    #: Friction coefficient of the wheels in place of the robot's; the controller is made for it.
    friction: float | None = None
    #: Half width of the uniform distribution of the true mass, CoM height and inertia, as a share; corners and draws.
    model_error: float = 0.0
    #: Options of the motors.
    actuators: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: Name of a set of sensors; controllers see the estimate then.
    sensors: str | None = None
    #: Name of a set of events.
    events: str | None = None
    #: Number of episodes with other random numbers.
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
        for name in ("tilt", "push", "push_every"):
            value = getattr(self, name)
            if isinstance(value, Sequence):
                object.__setattr__(self, name, tuple(float(number) for number in value))
        for name, least, most in (("seconds", 0.02, 3600.0), ("directions", 1, 360), ("seeds", 1, 10_000)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"scenario {self.id}: {name} = {getattr(self, name)}, expected from {least} to {most}")
        if not 0.0 <= self.measure_from < self.seconds:
            limit = f"expected from 0 to before seconds = {self.seconds}"
            raise ValueError(f"scenario {self.id}: measure_from = {self.measure_from}, {limit}")
        for name in ("tilt", "push"):
            self._check_axis(name)
        for name in ("push_height", "push_arm"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, (int, float)) and abs(value) <= _FARTHEST):
                raise ValueError(f"scenario {self.id}: {name} = {value}, expected a number within ±{_FARTHEST:g} m")
        if self.reference and self.reference.get("kind") not in KINDS:
            kind = self.reference.get("kind")
            raise ValueError(f"scenario {self.id}: reference.kind = {kind!r}, expected one of {', '.join(KINDS)}")
        if self.score not in (*SCORES, "map", "success") or self.is_map != (self.score == "map"):
            expected = "map, as for every map" if self.is_map else f"success, {', '.join(SCORES)}"
            raise ValueError(f"scenario {self.id}: score = '{self.score}', expected {expected}")
        if self.is_map and self.seconds <= HOLD:
            raise ValueError(f"scenario {self.id}: seconds = {self.seconds}, a map needs more than {HOLD:g}")
        if isinstance(self.tilt, tuple) and isinstance(self.push, tuple):
            raise ValueError(f"scenario {self.id}: either tilt or push can be a map")

    def _check_axis(self, name: str) -> None:
        """One finite number, or the first, the last and the step of increasing ones."""
        axis = getattr(self, name)
        numbers = axis if isinstance(axis, tuple) else (axis,)
        if not all(isinstance(number, (int, float)) and math.isfinite(number) for number in numbers):
            raise ValueError(f"scenario {self.id}: {name} = {axis}, expected finite numbers")
        if isinstance(axis, tuple) and not (len(axis) == 3 and axis[0] <= axis[1] and axis[2] > 0.0):
            raise ValueError(f"scenario {self.id}: {name} = {axis}, expected (first, last, step) with a step above 0")

    @property
    def moves(self) -> bool:
        """Whether the ball is to go somewhere."""
        return bool(self.reference) or self.step != 0.0

    @property
    def is_map(self) -> bool:
        """Whether it finds the largest tilt or push."""
        return isinstance(self.tilt, tuple) or isinstance(self.push, tuple)


def load(path: str | Path | None = None) -> dict[str, Scenario]:
    """The scenarios of a TOML file, a list of tables `scenario`, by their id; None are those of this package.

    Raises:
        ValueError: malformed TOML, a field that is not known or missing, or a number out of range.
        OSError: the file cannot be read.
    """
    if path is None:
        return dict(_shipped())
    return _parsed(Path(path).read_text(encoding="utf-8"), str(path))


@cache
def _shipped() -> dict[str, Scenario]:
    text = resources.files("ballbot_rs.scenarios").joinpath("scenarios.toml").read_text(encoding="utf-8")
    return _parsed(text, "scenarios.toml")


def _parsed(text: str, source: str) -> dict[str, Scenario]:
    tables = _toml.loads(text).get("scenario", [])
    if not tables:
        raise ValueError(f"{source} has no [[scenario]]")
    fields = [field.name for field in dataclasses.fields(Scenario)]
    found: dict[str, Scenario] = {}
    for table in tables:
        name = table.get("id", "?")
        for key in table:
            if key not in fields:
                raise ValueError(f"{source}: scenario {name} has no field '{key}'{did_you_mean(key, fields)}")
        if name in found:
            raise ValueError(f"{source}: there are two scenarios {name}")
        try:
            found[name] = Scenario(**table)
        except TypeError as error:
            raise ValueError(f"{source}: scenario {name}: {error}") from error
    return found


def select(names: Sequence[str], known: Mapping[str, Scenario]) -> list[Scenario]:
    """Scenarios by id, or by the start of it before a dash: `S13` names `S13-6s` and all others of S13.

    Raises:
        ValueError: a name that fits none.
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
