"""The episodes of a scenario on one robot: starts, disturbances and motions, all robots of a batch at once."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params, Reference, State
from ballbot_rs.analysis.pushes import Force, half_sine
from ballbot_rs.scenarios.scale import Scale
from ballbot_rs.scenarios.scenario import Axis, Scenario

Array = npt.NDArray[np.float64]

#: The robot that the numbers of scenarios refer to.
_PAPER: Final = Scale.of(Params.paper())


@dataclasses.dataclass(frozen=True)
class Trial:
    """Episodes of one scenario. Episodes of a map are ordered by its numbers, then by direction."""

    scenario: Scenario
    #: The robot for which the controller is made.
    nominal: Params
    #: The robot of each episode.
    robots: list[Params]
    starts: list[State]
    #: Pushes of each control step and episode, shape (steps, n, 3), N·s; None without pushes.
    impulses: Array | None
    #: Their points, body frame, m, shape (n, 3); None is the center of mass.
    points: Array | None
    #: The motion of each episode, or None for a fixed position.
    references: list[Reference] | None
    #: Desired ball positions without references, m, shape (n, 2).
    positions: Array
    #: The numbers of a map for this robot, deg or N·s, else empty.
    numbers: Array
    steps: int
    measure_from: float

    def __len__(self) -> int:
        return len(self.robots)


def trial(scenario: Scenario, params: Params, control_dt: float, *, seed: int = 0) -> Trial:
    """The episodes on the robot of `params`, with numbers scaled from the paper's robot."""
    scale = Scale.of(params)
    time = _slowness(scenario, params, scale)
    lean = scale.holdable_lean / _PAPER.holdable_lean
    nominal = params if scenario.friction is None else _with_friction(params, scenario.friction)
    steps = max(round(scenario.seconds * time / control_dt), 1)
    tilts, pushes = _values(scenario.tilt), _values(scenario.push)
    harder = scale.capture_impulse / _PAPER.capture_impulse
    numbers = (
        (tilts * lean if isinstance(scenario.tilt, tuple) else pushes * harder) if scenario.is_map else np.empty(0)
    )
    count = max(len(tilts), len(pushes))
    episodes = [
        (number, angle, k)
        for number in range(count)
        for angle in np.arange(scenario.directions) * 2.0 * np.pi / scenario.directions
        for k in range(scenario.seeds)
    ]
    robots, starts, impulses = [], [], np.zeros((steps, len(episodes), 3))
    points = np.zeros((len(episodes), 3))
    references: list[Reference] = []
    positions = np.zeros((len(episodes), 2))
    for i, (number, angle, k) in enumerate(episodes):
        direction = np.array([np.cos(angle), np.sin(angle)])
        positions[i] = scenario.step * direction
        # Depends only on the episode, not on the rate of the controller.
        rng = np.random.default_rng([seed, i])
        true = _true(scenario, nominal, direction, k, rng)
        robots.append(true)
        tilt = math.radians(tilts[min(number, len(tilts) - 1)]) * lean
        # Leaning towards an angle is a rotation about the axis 90 deg ahead of it.
        axis = np.array([-direction[1], direction[0]])
        start = State.at_equilibrium(true, tilt=tuple(tilt * axis))
        if scenario.tilt_rate != 0.0:
            rate = _in_body(start, scenario.tilt_rate * scale.toppling_rate * tilt * axis)
            start = State.rolling(true, (0.0, 0.0), start.body_quaternion, rate)
        starts.append(start)
        push = pushes[min(number, len(pushes) - 1)] * harder
        if push != 0.0:
            _push(scenario, impulses[:, i], push, direction, time, control_dt, rng)
        points[i] = _point(scenario, true, direction)
        if scenario.force != 0.0:
            force = scenario.force * scale.force_per_lean / _PAPER.force_per_lean * lean
            first, last = (
                round(min(t * time / control_dt, steps)) for t in (scenario.force_from, scenario.force_until)
            )
            if scenario.force_frequency == 0.0:
                impulses[first:last, i, :2] += force * control_dt * direction
            else:
                sine = Force((force, 0.0, 0.0), frequency=scenario.force_frequency / time)
                steps_of = range(last - first)
                shares = np.array([sine.share(step * control_dt, (step + 1) * control_dt) for step in steps_of])
                impulses[first:last, i, :2] += force * shares[:, None] * direction
        if scenario.reference:
            references.append(_reference(scenario, nominal, scale, time, rng, references))
    return Trial(
        scenario=scenario,
        nominal=nominal,
        robots=robots,
        starts=starts,
        impulses=impulses if impulses.any() else None,
        points=None if scenario.push_height is None and scenario.push_arm == 0.0 else points,
        references=references or None,
        positions=positions,
        numbers=numbers,
        steps=steps,
        measure_from=scenario.measure_from * time,
    )


#: Motions that are equally hard for another robot when they use the same fraction of its traction.
_BY_DEMAND: Final = ("line", "path", "stops", "square", "velocities", "circle", "lemniscate")

#: Smallest time of a motion relative to the paper's robot.
_FASTEST: Final = 0.2


def _slowness(scenario: Scenario, params: Params, scale: Scale) -> float:
    """Ratio of the time on the robot of `params` to the time on the paper's robot."""
    if scale == _PAPER:
        return 1.0
    if scenario.reference.get("kind") not in _BY_DEMAND:
        return _PAPER.toppling_rate / scale.toppling_rate
    demand = _made(scenario.reference, Params.paper(), 1.0).demand
    factor = _made(scenario.reference, params, _FASTEST).slowdown(min(max(demand, 0.01), 1.0))
    if factor is None:
        raise ValueError(f"scenario {scenario.id}: this robot cannot follow the motion at any speed")
    return _FASTEST * factor


def _values(axis: Axis) -> Array:
    if not isinstance(axis, tuple):
        return np.array([float(axis)])
    first, last, step = axis
    return np.linspace(first, last, round((last - first) / step) + 1, dtype=np.float64)


def _in_body(state: State, vector: Array) -> tuple[float, float, float]:
    """A horizontal vector of the inertial frame in the body frame."""
    w, x, y, z = state.body_quaternion
    q = np.array([x, y, z])
    v = np.array([vector[0], vector[1], 0.0])
    turned = v - 2.0 * w * np.cross(q, v) + 2.0 * np.cross(q, np.cross(q, v))
    return (float(turned[0]), float(turned[1]), float(turned[2]))


def _with_friction(params: Params, friction: float) -> Params:
    """The robot with this wheel friction; the floor friction is at least as large."""
    return params.replace(
        wheel_dynamic_friction=friction,
        wheel_static_friction=friction * params.wheel_static_friction / params.wheel_dynamic_friction,
    )


def _true(scenario: Scenario, nominal: Params, direction: Array, k: int, rng: np.random.Generator) -> Params:
    """The true robot, unknown to the controller."""
    changes: dict[str, Any] = {}
    if scenario.com_offset != 0.0:
        changes["body_com_offset"] = tuple(1e-3 * scenario.com_offset * direction)
    if scenario.slope != 0.0:
        changes["floor_tilt"] = tuple(math.radians(scenario.slope) * direction)
    if scenario.model_error != 0.0:
        # The first two are the corners.
        signs = {0: np.ones(3), 1: -np.ones(3)}.get(k, rng.uniform(-1.0, 1.0, 3))
        mass, height, inertia = 1.0 + scenario.model_error * signs
        changes["body_mass"] = nominal.body_mass * mass
        changes["body_com_height"] = nominal.body_com_height * height
        changes["body_inertia"] = tuple(inertia * np.asarray(nominal.body_inertia))
    return nominal.replace(**changes) if changes else nominal


def _point(scenario: Scenario, true: Params, direction: Array) -> Array:
    """Point of the pushes of an episode, body frame, m; distances scale with the height of the center of mass."""
    size = true.body_com_height / Params.paper().body_com_height
    x, y, z = true.body_com
    if scenario.push_height is not None:
        x, y, z = 0.0, 0.0, scenario.push_height * size
    left = scenario.push_arm * size
    return np.array([x - left * direction[1], y + left * direction[0], z])


def _push(
    scenario: Scenario,
    impulses: Array,
    push: float,
    direction: Array,
    time: float,
    control_dt: float,
    rng: np.random.Generator,
) -> None:
    """Adds the pushes of one episode, shape (steps, 3)."""
    steps = len(impulses)
    if scenario.push_every is not None:
        at = 0.0
        while True:
            at += float(rng.uniform(*scenario.push_every)) * time
            angle = float(rng.uniform(0.0, 2.0 * math.pi))
            if at >= scenario.seconds * time:
                return
            impulses[min(int(at / control_dt), steps - 1), :2] += push * np.array([math.cos(angle), math.sin(angle)])
    first = min(round(scenario.push_time * time / control_dt), steps - 1)
    count = min(max(round(scenario.push_duration * time / control_dt), 1), steps - first)
    impulses[first : first + count, :2] += push * half_sine(count)[:, None] * direction


def _reference(
    scenario: Scenario, params: Params, scale: Scale, time: float, rng: np.random.Generator, made: list[Reference]
) -> Reference:
    """The motion of one episode; motions without random numbers are made once."""
    table = dict(scenario.reference)
    lean = scale.holdable_lean / _PAPER.holdable_lean
    if table["kind"] == "attitude":
        table["lean"] = table.get("lean", math.nan) * lean
    if table["kind"] != "random_velocities":
        if made:
            return made[0]
        return _made(table, params, time)
    count = max(int(scenario.seconds / table["every"]), 1)
    # The same leans for the same fraction of the toppling time.
    faster = lean * time * scale.acceleration_per_lean / _PAPER.acceleration_per_lean
    velocities = rng.uniform(-table["largest"], table["largest"], (count, 2)) * (rng.random((count, 2)) < 0.5)
    return Reference.velocities(
        faster * velocities,
        np.arange(count) * table["every"] * time,
        table["change"] * time,
        yaw_rate=float(rng.uniform(-table["yaw_rate"], table["yaw_rate"])) / time,
        robot=params,
        friction=None,
    )


def _made(table: Mapping[str, Any], params: Params, time: float) -> Reference:
    """A motion without random numbers, its times multiplied by `time`."""
    try:
        return _motion(dict(table), params, time)
    except TypeError as error:
        raise ValueError(f"reference = {dict(table)}: {error}") from error


def _motion(arguments: dict[str, Any], params: Params, time: float) -> Reference:
    kind = arguments.pop("kind")
    for name in ("seconds", "period", "change", "start"):
        if name in arguments:
            arguments[name] *= time
    for name in ("velocities", "yaw_rate", "frequency"):
        if name in arguments:
            arguments[name] = (np.asarray(arguments[name]) / time).tolist()
    if "times" in arguments:
        arguments["times"] = (np.asarray(arguments["times"]) * time).tolist()
    if kind in ("circle", "lemniscate", "attitude"):
        arguments.setdefault("start", 4.0 * time)
    make: Any = getattr(Reference, kind)
    found: Reference = make(**arguments, robot=params, friction=None)
    return found
