"""Families of robots: ballbots of all sizes, sampled at random.

Their sizes span the robots of `ROBOTS`; torques and frictions are relative to what the size of the
robot demands (`Params.scale`).
"""

import contextlib
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final

import numpy as np

from ballbot_rs._checks import check_count, check_options, check_real, check_seed
from ballbot_rs._core import SAME_ROBOT, Batch, Params
from ballbot_rs._errors import InvalidInputError

#: Least and most of numbers, by name.
Ranges = Mapping[str, tuple[float, float]]

#: Ranges of lengths, masses and ratios that are sampled log-uniformly.
RANGES: Final[Ranges] = {
    # m
    "ball_radius": (0.08, 0.2),
    # kg
    "body_mass": (2.0, 25.0),
    "ball_mass / body_mass": (0.08, 0.7),
    # Of a solid ball to a thin shell.
    "ball_inertia / (ball_mass ball_radius^2)": (0.5, 0.6667),
    "body_com_height / ball_radius": (1.1, 5.0),
    "gyration radius / body_com_height": (0.5, 2.8),
    "body_inertia y / x": (0.9, 1.1),
    "gyration radius about the mast / ball_radius": (0.5, 1.2),
    "wheel_radius / ball_radius": (0.3, 0.55),
    "wheel_mass / body_mass": (0.012, 0.06),
    # With the inertia of the rotor of its motor.
    "wheel_inertia / (body_mass wheel_radius^2)": (0.008, 0.1),
    # rad
    "wheel_zenith": (0.7, 0.87),
    # N·m on the paper's robot.
    "max_wheel_torque": (0.21, 1.0),
    "friction": (0.8, 1.1),
}

#: Ranges that are sampled uniformly, as they include 0.
LINEAR: Final[Ranges] = {
    # N·m, and N·m/(rad/s), on the paper's robot.
    "wheel_coulomb_friction": (0.0, 0.013),
    "wheel_viscous_friction": (0.0, 0.001),
    "body_com_offset / body_com_height": (-0.015, 0.015),
}

#: Ranges that are sampled uniformly and last, so that without them robots stay what they are.
LAST: Final[Ranges] = {"wheel_preload / weight of the body": (0.0, 0.0)}

#: Least and most of what `LAST` names; beyond it no robot is valid.
_BOUNDS: Final[Ranges] = {"wheel_preload / weight of the body": (0.0, 1e3)}


#: Most robots of a family: as many as a batch has environments.
MOST_ROBOTS: Final = 2**20

#: Largest bound of a range.
LARGEST: Final = 1e6

#: Sampled robots of which one must be valid.
MOST_ATTEMPTS: Final = 1000


def sample_robots(count: int, seed: int = 0, ranges: Ranges | None = None) -> list[Params]:
    """Robots of the family of ballbots; robot i depends only on the seed, i and the ranges.

    Args:
        count: number of robots.
        seed: of the random numbers.
        ranges: smallest and largest value by name in `RANGES`, `LINEAR` and `LAST`, replacing their ranges.

    Raises:
        ValueError: a number out of range, or ranges in which hardly any robot is valid.
    """
    check_count("count", count)
    given = {} if ranges is None else ranges
    if not isinstance(given, Mapping):
        raise TypeError(f"robot.ranges = {given!r} is not a table of ranges")
    usual = {**RANGES, **LINEAR, **LAST}
    check_options("robot.ranges", given, tuple(usual))
    checked = {name: _range(name, given.get(name, bounds)) for name, bounds in usual.items()}
    return [_robot(np.random.default_rng([check_seed(seed), i]), checked) for i in range(count)]


def robots_of(spec: Mapping[str, Any], num_envs: int) -> list[Params]:
    """Robots of the value of an option `robot` with the key `family`: their number, a `seed` and `ranges`.

    Raises:
        ValueError: an unknown key, or a number out of range.
        TypeError: as `sample_robots`.
    """
    check_options("robot with a family", spec, ("family", "seed", "ranges"))
    # The others have no place.
    return sample_robots(min(number_of(spec), room(num_envs)), spec.get("seed", 0), spec.get("ranges"))


def room(num_envs: int) -> int:
    """How many different robots a batch can have."""
    return -(-num_envs // SAME_ROBOT)


def check_room(params: Any, num_envs: int) -> None:
    """Checks that a batch has room for all robots of the value of an option `robot`.

    Raises:
        ValueError: it has not, or as `number_of`.
    """
    if isinstance(params, (list, tuple)) and len(params) == 2:
        paths = [one for one in params if isinstance(one, (str, PathLike))]
        if any(str(path).endswith(".urdf") for path in paths):
            raise InvalidInputError(f"robot = {params!r}: for two URDFs write Params.from_urdf(bot_path, ball_path)")
    robots, most = number_of(params), room(num_envs)
    if robots > most:
        raise InvalidInputError(
            f"robot has {robots} robots, but num_envs = {num_envs} has room for {most}: "
            f"{SAME_ROBOT} neighbors have the same robot, so it must be at least {SAME_ROBOT * (robots - 1) + 1}"
        )


def is_family(params: Any) -> bool:
    """Whether the value of an option `robot` is a family."""
    return isinstance(params, Mapping) and "family" in params


def is_list(params: Any) -> bool:
    """Whether the value of an option `robot` is a list of robots."""
    return isinstance(params, Sequence) and not isinstance(params, str)


def number_of(params: Any) -> int:
    """How many robots the value of an option `robot` has.

    Raises:
        ValueError: a number of a family out of range.
        TypeError: not a whole number.
    """
    if not is_family(params):
        return len(params) if is_list(params) else 1
    count = check_count("robot.family", params["family"])
    if count > MOST_ROBOTS:
        raise InvalidInputError(f"robot.family = {count} is out of range: it must be at most {MOST_ROBOTS}")
    return count


def are_several(params: Any) -> bool:
    """Whether the value of an option `robot` is of several robots."""
    return number_of(params) != 1


def at_most(params: Any, num_envs: int) -> Any:
    """The value of an option `robot`, of no more robots than a batch has room for."""
    if is_family(params):
        return {**params, "family": min(params["family"], room(num_envs))}
    return params[: room(num_envs)] if is_list(params) else params


def first_of(params: Any) -> Any:
    """The value of an option `robot`, of the first robot alone."""
    if is_family(params):
        return robots_of(params, 1)[0].to_dict()
    return params[0] if is_list(params) else params


def robots_in(batch: Batch) -> list[Params]:
    """The robot of each block of equal neighbors in a batch."""
    return [batch.nominal_params(i) for i in range(0, batch.num_envs, SAME_ROBOT)]


def has_several_robots(batch: Batch) -> bool:
    """Whether a batch was made with several robots."""
    first, *others = robots_in(batch)
    return any(robot != first for robot in others)


def _range(name: str, bounds: Any) -> tuple[float, float]:
    """A range of a name in `RANGES`, `LINEAR` or `LAST`.

    Raises:
        ValueError: not two numbers in ascending order, not positive where they are sampled log-uniformly, or out of
            range.
    """
    if isinstance(bounds, str) or not isinstance(bounds, Sequence) or len(bounds) != 2:
        raise InvalidInputError(f"robot.ranges[{name!r}] = {bounds!r}: expected a smallest and a largest number")
    least, most = (check_real(f"robot.ranges[{name!r}]", bound) for bound in bounds)
    lowest, highest = _BOUNDS.get(name, (np.finfo(float).tiny if name in RANGES else -LARGEST, LARGEST))
    if not lowest <= least <= most <= highest:
        kind = "positive numbers" if name in RANGES else "numbers of at least 0" if name in _BOUNDS else "numbers"
        raise InvalidInputError(
            f"robot.ranges[{name!r}] = {bounds!r}: expected two {kind} in ascending order, at most {highest:g}"
        )
    return least, most


def _robot(rng: np.random.Generator, ranges: Ranges) -> Params:
    """A sampled robot: the first that is valid."""
    for _ in range(MOST_ATTEMPTS):
        with contextlib.suppress(ValueError):
            return _attempt(rng, ranges)
    raise InvalidInputError(f"robot.ranges: none of {MOST_ATTEMPTS} sampled robots is valid")


def _attempt(rng: np.random.Generator, ranges: Ranges) -> Params:
    """A sampled robot.

    Raises:
        ValueError: the numbers make no robot.
    """
    r = {name: float(np.exp(rng.uniform(*np.log(ranges[name])))) for name in RANGES}
    r |= {name: float(rng.uniform(*ranges[name])) for name in LINEAR}
    along = float(rng.uniform(-np.pi, np.pi))
    radius, mass = r["ball_radius"], r["body_mass"]
    ball_mass = mass * r["ball_mass / body_mass"]
    height = radius * r["body_com_height / ball_radius"]
    wheel_radius = radius * r["wheel_radius / ball_radius"]
    across = mass * (height * r["gyration radius / body_com_height"]) ** 2
    upright = mass * (radius * r["gyration radius about the mast / ball_radius"]) ** 2
    offset = height * r["body_com_offset / body_com_height"]
    friction = r["friction"]
    robot = Params(
        ball_mass=ball_mass,
        ball_inertia=ball_mass * radius**2 * r["ball_inertia / (ball_mass ball_radius^2)"],
        ball_radius=radius,
        body_mass=mass,
        body_inertia=(across, across * r["body_inertia y / x"], upright),
        body_com_height=height,
        body_com_offset=(offset * np.cos(along), offset * np.sin(along)),
        wheel_mass=mass * r["wheel_mass / body_mass"],
        wheel_inertia=mass * wheel_radius**2 * r["wheel_inertia / (body_mass wheel_radius^2)"],
        wheel_radius=wheel_radius,
        wheel_zenith=r["wheel_zenith"],
        wheel_static_friction=friction,
        wheel_dynamic_friction=friction,
        floor_static_friction=friction,
        floor_dynamic_friction=friction,
    )
    if any(ranges[name] != bounds for name, bounds in LAST.items()):
        weights = float(rng.uniform(*ranges["wheel_preload / weight of the body"]))
        robot = robot.replace(wheel_preload=weights * mass * robot.gravity)
    torque = robot.scale("N·m")
    return robot.replace(
        max_wheel_torque=torque * r["max_wheel_torque"],
        wheel_coulomb_friction=torque * r["wheel_coulomb_friction"],
        wheel_viscous_friction=robot.scale("N·m/(rad/s)") * r["wheel_viscous_friction"],
    )
