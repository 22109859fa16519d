"""Every keyword changes something, or is rejected by name: none is ignored.

Numbers are tried separately, at other values than the default. A keyword that is not a number, or that acts only
together with another keyword, is in a table. A new keyword that is not in a table fails its test.
"""

import functools
import inspect
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import ACTUATOR_OPTIONS, CONTROLLERS, SENSOR_OPTIONS, TASKS
from ballbot_rs.envs.own.stage import Stage
from tests.support.keywords import PAPER, START, Refused, Same, With, changes
from tests.support.paths import ASSETS

STEEP = PAPER.replace(wheel_zenith=0.7)


SPEEDS = (0.3, 0.1, 0.3, 0.2, 0.9, 2.0)
SLOPE = bb.Terrain.plane(0.1)
BOWL = bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05)
LEVELS = bb.Terrain.generate("levels", tile=6.0, levels=3, cell=0.1)


def numbers(option: Mapping[str, Any]) -> list[Any]:
    """Other values of an option that is a number, or several."""
    default = option["default"]
    if isinstance(default, list):
        return [[0.5 * value for value in default], [value + 0.1 for value in default]]
    if isinstance(default, float):
        return [0.5 * default, 2.0 * default] if default else [1.0, 0.1, 0.01]
    return []


# Environments ------------------------------------------------------------------------------------------------------

#: Options that are not numbers, or act together with others.
OPTIONS: dict[str, list[Any]] = {
    "robot": ["kugle"],
    "model": ["rigid"],
    "sim_dt": [0.001],
    "control_dt": [0.02],
    "max_wheel_torque": [0.1],
    "max_episode_steps": [7],
    "scale_observations": [False],
    "scale_by_robot": [True],
    "integral_rate": [Refused(1.0)],
    "balance.integral_rate": [1.0],
    "push.integral_rate": [1.0],
    "history": [2],
    "terrain": ["wave", SLOPE],
    "actuators": [{"delay": 0.01}],
    "sensors": [{"gyro_noise": 0.1}],
    "scan": [{"points": (2, 3)}],
    "depth": [{"size": (2, 3)}],
    "lidar": [{"beams": 5}],
    "level": [1],
    "velocity.level": [With(1, terrain=LEVELS)],
    "observation": [With("sensors", sensors={"gyro_noise": 0.1})],
    "events": [[{"term": "body_mass", "op": "scale", "range": [1.1, 1.2]}]],
    # Of `push`, a range of impulses.
    "push": [With([0.5, 0.6], push_seconds=[0.1, 0.1])],
    "push_seconds": [[0.1, 0.1]],
    "push_duration": [With(0.05, push_seconds=[0.1, 0.1])],
    "command_seconds": [[0.05, 0.1]],
    "path_kinds": [[0.0, 1.0, 0.0, 0.0]],
    # How near is near enough: as far as any robot gets.
    "success_window": [With(0.01, success_tilt=0.3, success_radius=10.0)],
    "success_tilt": [With(0.3, success_radius=10.0, success_window=0.01)],
    "success_radius": [With(10.0, success_tilt=0.3, success_window=0.01)],
    "success_velocity": [With(10.0, success_yaw_rate=10.0, settling=0.0)],
    "success_yaw_rate": [With(10.0, success_velocity=10.0, settling=0.0)],
    "success_error": [With(1e-6, settling=0.0)],
    "success_share": [0.01, 1.0],
    "goal_radius": [With(10.0, hold_seconds=0.01)],
    "goal_seconds": [[0.05, 0.1]],
    "hold_seconds": [With(0.01, goal_radius=10.0)],
    "velocity.settling": [With(0.0, success_velocity=10.0, success_yaw_rate=10.0)],
    "path.settling": [0.0],
    "standing": [1.0],
    "hardest": [With(0.1, terrain=None)],
    "openballbot.speed": [0.01],
    "fall_tilt": [0.1],
    # Its first tilts are smaller.
    "carry.fall_tilt": [0.055],
    "navigate.fall_tilt": [0.055],
    "guide": [1.0],
    # Of its fading near the goal.
    "range": [With(4.0, guide=1.0)],
    "ride.fall_tilt": [0.055],
    "cruise_seconds": [[0.03, 0.2]],
    "stop_seconds": [[0.03, 0.2]],
    "ride.success_velocity": [1e-6],
    "success_distance": [1e-6],
    "stopped_speed": [1e-6],
    "stopped_seconds": [1.0],
}


#: A wall next to robots at the origin.
WALL = bb.Terrain.plane(0.0).with_obstacles([{"kind": "wall", "x": 0.175, "yaw": np.pi}])

#: Smaller ground than in the task, which takes seconds.
GROUNDS = {"terrain": "levels", "openballbot": "noise"}


@functools.cache
def ground(kind: str) -> bb.Terrain:
    """Made once."""
    return LEVELS if kind == "levels" else bb.Terrain.generate(kind, size_x=6.0, size_y=6.0, cell=0.05)


def episodes(task: str, **options: Any) -> list[Any]:
    """The motion of robots in an environment, and what it reports."""
    if task in GROUNDS:
        options = {"terrain": ground(GROUNDS[task]), **options}
    if task == "navigate":
        # A wall that robots touch, as fast and for as long as that takes.
        options = {"terrain": WALL, "max_episode_steps": 30, "reset_ball_speed": 0.6, **options}
    if task == "ride":
        # Riders who stop at once.
        brakes = {"cruise_seconds": (0.05, 0.05), "stop_seconds": (0.1, 0.1), "success_velocity": 10.0}
        options = {"max_episode_steps": 30, "stopped_speed": 5.0, "stopped_seconds": 0.03, **brakes, **options}
    batch = bb.Batch(4, task, seed=3, num_threads=1, **{"model": "contact", "max_episode_steps": 12, **options})
    found: list[Any] = [batch.reset(), batch.states()]
    for step in range(30):
        actions = 0.4 * np.sin(np.arange(12.0).reshape(4, 3) + 0.3 * step)
        found += [*batch.step(actions), batch.states(), *batch.endings(), batch.command(), batch.reward_terms()]
        found += [batch.setpoint(0), batch.metrics()]
        if batch.options["sensors"] is not None:
            found.append(batch.readings())
    return found


@pytest.mark.slow("all keywords")
@pytest.mark.parametrize("task", TASKS)
def test_options_of_environments(task):
    described = {option["name"]: option for option in TASKS[task]["options"]}
    names = ["robot", "model", *bb.Batch(1, task, num_threads=1).options]
    found = []
    call, base = functools.partial(episodes, task), {}
    for name in names:
        if name == "reward":
            for term in TASKS[task]["rewards"]:
                reward = [{term["name"]: 2.0 * term["scale"] + 1.0}]
                found.append(changes(call, "reward", reward, base))
            continue
        number = numbers(described.get(name, {"default": None}))
        candidates = OPTIONS.get(f"{task}.{name}") or OPTIONS.get(name) or number
        found.append(changes(call, name, candidates, base) if candidates else name)
    assert not [wrong for wrong in found if wrong]


@pytest.mark.parametrize("model", ["planar", "spatial", "contact", "rigid"])
def test_terms_of_events(model):
    """A term that the model does not have randomized nothing."""
    ripple = [{"term": "roller_ripple", "range": [1e-4, 1e-4]}] if model in ("contact", "rigid") else []
    options = {"max_wheel_torque": 3.0, "max_episode_steps": 40, "fall_tilt": 3.0}

    def run(*others, events=()):
        batch = bb.Batch(4, model=model, seed=3, num_threads=1, events=[*others, *events], **options)
        found = [batch.reset()]
        for step in range(30):
            actions = (0.4 if step < 10 else 1.0) * np.sin(np.arange(12.0).reshape(4, 3) + 0.3 * step)
            found += [*batch.step(actions)[:2], batch.states()]
        return found

    found = []
    for term, value in PAPER.to_dict().items():
        others = ripple if term in ("roller_count", "roller_phases") else []
        if term in ("floor_static_friction", "floor_friction_gradient") and ripple:
            # A floor that slips.
            others = [{"term": "floor_dynamic_friction", "range": [0.03, 0.03]}]
        op, ranges = ("scale", ([0.9, 0.9], [1.02, 1.05], [0.05, 0.06])) if np.any(value) else ("add", ([0.01, 0.02],))
        ranges = {"roller_ripple": ([1e-4, 2e-4],), "roller_phases": ([1.0, 2.0],)}.get(term, ranges)
        events = [[{"term": term, "op": op, "range": list(pair)}] for pair in ranges]
        if wrong := changes(functools.partial(run, *others), "events", events, {}, named=term):
            found.append((term, wrong))
    assert not found


# Controllers ---------------------------------------------------------------------------------------------------------

#: Options that act together with others, or need other values.
CONTROLLER_OPTIONS: dict[str, list[Any]] = {
    "hierarchical_sliding_mode.leakage": [Refused(0.5), With(20.0, adaptation=50.0, switching=0.25, layer=0.05)],
    "hierarchical_sliding_mode.max_switching": [
        Refused(3.0),
        With(0.3, adaptation=500.0, switching=0.25, layer=0.05),
    ],
    "admittance.yield_speed": [1e-4],
    "admittance.yield_acceleration": [0.01],
    "hierarchical_sliding_mode.adaptation": [With(50.0, switching=0.25, layer=0.05)],
    "delay": [0.01],
    "horizon": [6.0, 0.3],
    "step": [0.02],
    "samples": [64.0],
    "seed": [1.0],
    "iterations": [1.0],
    "max_lean": [0.02],
    "max_speed": [0.02],
    "max_integral_lean": [1e-5],
    "violation": [1e-3, 10.0],
}


def closed_loop(name: str, **options: Any) -> list[Any]:
    """Torques of a controller on a robot that is pushed and far from its setpoint."""
    faster = {"mppi": {"samples": 32.0, "horizon": 0.2}, "nmpc": {"horizon": 0.2}}.get(name, {})
    law = bb.Controller(name, **{**faster, **options})
    robot = bb.Ballbot(PAPER, "spatial", 0.001)
    robot.reset(START)
    follows = {"position": (0.6, -0.4), "yaw": -0.5}
    parts = {part: value for part, value in follows.items() if part in law.setpoint_parts}
    torques = []
    steps = round(law.control_dt / 0.001)
    for step in range(60 if name == "mppi" else 300):
        if step == 30:
            robot.push((0.6, 0.3, 0.0))
        torques.append(law(robot.state, **parts))
        robot.step(torques[-1], steps)
    return torques


@pytest.mark.parametrize("name", CONTROLLERS)
def test_options_of_controllers(name):
    found = []
    call, base = functools.partial(closed_loop, name), {}
    for option in CONTROLLERS[name]["options"]:
        key = option["name"]
        candidates = CONTROLLER_OPTIONS.get(f"{name}.{key}") or CONTROLLER_OPTIONS.get(key) or numbers(option)
        for candidate in candidates if f"{name}.{key}" in CONTROLLER_OPTIONS else [None]:
            tried = candidates if candidate is None else [candidate]
            found.append(changes(call, key, tried, base))
    assert not [wrong for wrong in found if wrong]


# Tables of options --------------------------------------------------------------------------------------------------

_CURVE = {"stall_torque": 0.1, "no_load_speed": 5.0}
#: Options of actuators and sensors that act together with others.
STAGES: dict[str, list[Any]] = {
    "stall_torque": [With(0.05, **_CURVE)],
    "no_load_speed": [With(3.0, **_CURVE)],
    "delay": [0.01],
    "delay_jitter": [With(0.01, delay=0.01)],
    "lag": [0.02],
    "speed_limit": [1.0],
    "peak_torque": [0.05],
    "strength": [0.5],
}


def test_options_of_actuators():
    def run(**actuators):
        return episodes("balance", actuators=actuators)[3:]

    found = [changes(run, o["name"], STAGES.get(o["name"]) or numbers(o), {}) for o in ACTUATOR_OPTIONS]
    assert not [wrong for wrong in found if wrong]


def test_options_of_sensors():
    def run(**sensors):
        options = {"sensors": sensors, "observation": "sensors", "model": "rigid", "max_episode_steps": 40}
        return episodes("balance", **options)

    table = {"latency": [0.01], "encoder_ticks": [100.0], "imu_position": [[0.1, 0.0, 0.2]]}
    found = [changes(run, o["name"], table.get(o["name"]) or numbers(o), {}) for o in SENSOR_OPTIONS]
    assert not [wrong for wrong in found if wrong]


@pytest.mark.slow("all keywords")
@pytest.mark.parametrize("kind", bb.terrain_kinds())
def test_parameters_of_terrains(kind):
    """At the size at which they are made."""
    table = {
        "apron": [1.0],
        "apron_blend": [With(1.0, apron=0.8)],
        "direction": [0.5],
        "size_x": [3.0],
        "size_y": [3.0],
        "cell": [0.015],
        "distance": [0.5],
        "lacunarity": [1.5],
    }
    small = {"cell": 0.01, "size_x": 2.0, "size_y": 2.0} if "size_x" in bb.terrain_kinds()[kind] else {"tile": 6.0}
    small = {} if kind == "plane" else small
    make = functools.partial(bb.Terrain.generate, kind)
    found = []
    for name, option in bb.terrain_kinds()[kind].items():
        candidates = table.get(name) or [value for value in numbers(option) if name != "persistence" or value <= 1.0]
        if name == "gap":
            candidates = [1.5]
        if name in ("levels", "tiles", "octaves"):
            candidates = [2]
        found.append(changes(make, name, candidates, small))
    assert not [wrong for wrong in found if wrong]


# Functions and constructors -----------------------------------------------------------------------------------------


def _state_of(thing: Any) -> Any:
    return thing.to_array()


def _robot(**arguments: Any) -> Any:
    robot = bb.Ballbot(**arguments)
    robot.reset(bb.State.at_equilibrium(robot.params, tilt=(0.1, 0.0)))
    robot.step([0.3, 0.1, 0.0], 20)
    return [robot.state, robot.sim_dt]


def _crowd(**arguments: Any) -> Any:
    """Two robots that collide."""
    given = {"robots": ["paper", "paper"], "positions": [(0.0, 0.0), (0.6, 0.02)], **arguments}
    crowd = bb.Crowd(**given)
    for robot, speed in ((0, 1.5), (1, -1.5)):
        crowd.push(robot, (speed * crowd.params[robot].body_mass, 0.0, 0.0))
    crowd.step(np.zeros((2, 3)), round(0.3 / crowd.sim_dt))
    return crowd.states


def _front_end(make: Callable[..., Any], **arguments: Any) -> Any:
    env = make(**arguments)
    found = [env.reset(seed=None if "seed" in arguments else 0), env.task, getattr(env, "num_envs", 1)]
    found += [env.render_mode, env.render() if env.render_mode else None]
    for step in range(12):
        n = getattr(env, "num_envs", None)
        found.append(env.step(np.full((3,) if n is None else (n, 3), 0.3 * (-1) ** step)))
    return found


def _frame(**arguments: Any) -> Any:
    return bb.Renderer(**{"width": 40, "height": 30, **arguments}).render(START)


def _linear(**arguments: Any) -> Any:
    model = bb.LinearModel(**arguments)
    return [model.A, model.B]


def _progress(call: Callable[..., Any], **arguments: Any) -> Any:
    """How often `progress` is called belongs to the result."""
    messages: list[Any] = []
    if arguments.get("progress") == "messages":
        arguments["progress"] = lambda *numbers: messages.append(numbers)
    return [call(**arguments), bool(messages)]


def _optimized(**arguments: Any) -> Any:
    found = bb.optimize_trajectory(**arguments)
    return [found.torques, found.iterations]


def _written(write: Callable[..., Path], path: str, **arguments: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return write(path=Path(folder) / path, **arguments).read_bytes()


def _estimated(**arguments: Any) -> bytes:
    """An estimate after readings that are wrong for a robot at rest."""
    estimator = bb.Estimator(**arguments)
    for _ in range(3):
        readings = {"gyro": (0.1, 0.2, 0.0), "specific_force": (0.3, 0.0, 9.8), "wheel_angles": (0.0, 0.1, 0.0)}
        state = estimator.update(readings)
    return state.to_array().tobytes()


def _read(path: bb.Terrain, **arguments: Any) -> Any:
    """What is read of the picture of a terrain."""
    with tempfile.TemporaryDirectory() as folder:
        return bb.read_terrain(bb.write_terrain(path, Path(folder) / "a.png"), **arguments)


@functools.cache
def _log(seed: int) -> bb.SensorLog:
    return bb.record_log(seconds=4.0, seed=seed)


def _identify(call: Callable[..., Any], log: int, **arguments: Any) -> Any:
    return _progress(call, log=_log(log), **arguments)


def _replay(call: Callable[..., Any], log: int, **arguments: Any) -> Any:
    found, has_messages = _progress(call, log=_log(log), **arguments)
    return [found.to_dict(), has_messages]


GENTLE = bb.Terrain.generate("noise", size_x=3.0, size_y=3.0, cell=0.05)
TILTED = bb.Scenario("tilted", "", seconds=0.5, tilt=4.0, score="rms_tilt")
SHORTER = bb.Scenario("tilted", "", seconds=0.4, tilt=4.0, score="rms_tilt")
#: Limits of the motion, of every law.
BARRIER = {"speed_limit": 0.05, "boundary": (-0.1, 0.1, -0.1, 0.1)}
#: Options of the environment, which mean the same wherever a robot is simulated.
SETUP: dict[str, Any] = {
    "robot": "kugle",
    "model": "rigid",
    "actuators": {"delay": 0.01},
    "sensors": With({"gyro_noise": 0.1}, observation="sensors"),
    "observation": With("sensors", sensors={"gyro_noise": 0.1}),
    "terrain": SLOPE,
    "events": [{"term": "push", "at": 0.05, "range": [0.2, 0.3]}],
    "control_dt": 0.02,
}
#: Keywords with another value than the default by callable: how it is called, its other arguments, and the keywords.
#: None is a keyword whose effect is elsewhere.
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]] = {
    "Crowd": (
        _crowd,
        {},
        {
            "robots": ["paper", "kugle"],
            "positions": [(0.0, 0.0), (0.7, 0.0)],
            "friction": 0.0,
            "restitution": 0.4,
            "sim_dt": 0.0005,
            "terrain": BOWL,
        },
    ),
    "Ballbot": (_robot, {}, {"robot": "kugle", "model": "rigid", "sim_dt": 0.0005, "terrain": BOWL}),
    "Controller": (
        bb.Controller,
        {"name": "lqr"},
        {
            "name": "lqi",
            "robot": "kugle",
            "control_dt": 0.02,
            "max_torque": 0.05,
            "traction": 0.1,
            "scaled": {"position": 0.3},
            **BARRIER,
        },
    ),
    "Lqr": (
        bb.Lqr,
        {},
        {
            "robot": "kugle",
            "control_dt": 0.02,
            "Q": np.ones(10),
            "R": np.ones(3),
            "max_torque": 0.05,
            "traction": 0.1,
            **BARRIER,
        },
    ),
    "Pid": (
        bb.Pid,
        {},
        {
            "robot": "kugle",
            "control_dt": 0.004,
            "mapping": "as_printed",
            "max_torque": 0.05,
            "traction": True,
            **BARRIER,
        },
    ),
    "LinearModel": (_linear, {}, {"robot": "kugle"}),
    "SpatialModel": (
        lambda **given: bb.SpatialModel(**given).accelerations(
            START.body_quaternion, SPEEDS[: 6 if given.get("ball_spins_about_vertical", True) else 5], (0.1, 0.2, 0.3)
        ),
        {"robot": PAPER},
        {"robot": bb.Params.preset("kugle"), "absolute_wheel_spin": False, "ball_spins_about_vertical": False},
    ),
    "PlanarModel": (
        lambda **given: bb.PlanarModel(**given).linearize(),
        {"robot": PAPER},
        {
            "robot": bb.Params.preset("kugle"),
            "wheel_inertia": "three_wheels",
            "plane": With("xz", robot=PAPER.replace(body_inertia=(0.2, 0.22, 0.05))),
        },
    ),
    "Renderer": (
        _frame,
        {},
        {
            "robot": "kugle",
            "urdf": (ASSETS / "bot.urdf", ASSETS / "ball.urdf"),
            "width": 20,
            "height": 20,
            "samples": 2,
            "camera": {"distance": 2.0},
            "num_threads": Same(2),
            "terrain": SLOPE,
        },
    ),
    "State": (
        lambda **given: bb.State(**given),
        {"ball_position": (0.0, 0.0, 0.12)},
        {
            "ball_position": (0.1, 0.0, 0.12),
            "ball_velocity": (0.1, 0.0, 0.0),
            "ball_angular_velocity": (0.1, 0.0, 0.0),
            "body_quaternion": (0.0, 1.0, 0.0, 0.0),
            "body_angular_velocity": (0.1, 0.0, 0.0),
            "wheel_speeds": (0.1, 0.0, 0.0),
            "ball_quaternion": (0.0, 1.0, 0.0, 0.0),
            "wheel_angles": (0.1, 0.0, 0.0),
            "body_position": (0.1, 0.0, 0.3),
            "body_velocity": (0.1, 0.0, 0.0),
        },
    ),
    "Setpoint": (
        bb.Setpoint,
        {},
        {name: 0.1 if name.startswith("yaw") else (0.1, 0.2) for name in bb.Setpoint()},
    ),
    "Push": (
        lambda **given: bb.simulate("lqr", seconds=0.5, pushes=[bb.Push(**given)]).to_array(),
        {"impulse": (0.1, 0.0, 0.0), "time": 0.1},
        {"impulse": (0.0, 0.1, 0.0), "time": 0.2, "duration": 0.1, "point": (0.0, 0.1, 0.3)},
    ),
    "Force": (
        lambda **given: bb.simulate("lqr", seconds=0.5, forces=[bb.Force(**given)]).to_array(),
        {"force": (0.5, 0.0, 0.0)},
        {"force": (0.0, 0.5, 0.0), "begin": 0.2, "end": 0.3, "point": (0.0, 0.1, 0.3), "frequency": 3.0},
    ),
    "simulate": (
        bb.simulate,
        {"controller": "lqr", "seconds": 0.3},
        {
            "controller": "lqi",
            "reference": bb.Reference.line((0.1, 0.0), 2.0),
            "pushes": [bb.Push((0.1, 0.0, 0.0), 0.1)],
            "forces": [bb.Force((0.1, 0.0, 0.0))],
            "seconds": 0.2,
            "start": START,
            "position": (0.1, 0.0),
            "tilt": (0.05, 0.0),
            "yaw": 0.2,
            "task": "velocity",
            **SETUP,
            "seed": With(1, events=[{"term": "push", "at": 0.1, "range": [0.2, 0.3]}]),
        },
    ),
    "record_dataset": (
        functools.partial(_progress, bb.record_dataset),
        {"controller": "lqr", "episodes": 2, "max_episode_steps": 10},
        {
            "controller": "lqi",
            "episodes": 3,
            "noise": 0.1,
            "task": "velocity",
            **SETUP,
            "seed": 1,
            "num_threads": Same(2),
            "progress": "messages",
        },
    ),
    "rollout": (
        functools.partial(_progress, bb.rollout),
        {"controller": "lqr", "num_robots": 2, "seconds": 0.1},
        {
            "controller": "lqi",
            "num_robots": 3,
            "robots": {"body_mass": [2.0, 2.5]},
            "seconds": 0.2,
            "tilt": (0.05, 0.0),
            "record": ("torques",),
            "every": 2,
            "dtype": "float64",
            "task": "velocity",
            **SETUP,
            "seed": 1,
            "num_threads": Same(2),
            "progress": "messages",
        },
    ),
    "compare": (
        functools.partial(_progress, bb.compare),
        {"controllers": ["lqr"], "episodes": 2, "max_episode_steps": 20},
        {
            "controllers": ["lqi"],
            "task": "velocity",
            "episodes": 3,
            "seed": 1,
            "num_threads": Same(2),
            **SETUP,
            "engine": None,
            "sweep": {"body_mass": [2.0, 2.5]},
            "checkpoint": None,
            "progress": "messages",
        },
    ),
    "run_scenarios": (
        functools.partial(_progress, bb.run_scenarios),
        {"controllers": "lqr", "scenarios": TILTED},
        {
            "controllers": "lqi",
            "scenarios": bb.Scenario("other", "", seconds=0.5, push=0.1, score="rms_tilt"),
            "file": None,
            "robot": "kugle",
            "model": "rigid",
            "actuators": {"delay": 0.01},
            "sensors": "kugle",
            "events": "mild",
            "seed": With(1, scenarios=bb.Scenario("x", "", seconds=0.3, score="rms_tilt", events="mild", seeds=2)),
            "num_threads": Same(2),
            "sweep": {"body_mass": [2.0, 2.5]},
            "checkpoint": None,
            "progress": "messages",
        },
    ),
    "record_log": (
        functools.partial(_progress, bb.record_log),
        {"seconds": 0.3},
        {
            "robot": "kugle",
            "seconds": 0.2,
            "actuators": {"delay": 0.01},
            "controller_robot": bb.Params.paper().replace(body_mass=2.4),
            "model": "rigid",
            "sim_dt": 0.001,
            "control_dt": 0.02,
            "imu_position": (0.0, 0.1, 0.2),
            "noise": {"gyro": 0.5},
            "excitation": 0.5,
            "pose": True,
            "seed": 1,
            "progress": None,
        },
    ),
    "make_controller": (
        bb.make_controller,
        {"name": "lqr"},
        {"name": "lqi", "robot": "kugle", "control_dt": 0.02},
    ),
    "virtual_to_wheel_torques": (
        bb.virtual_to_wheel_torques,
        {"robot": PAPER, "virtual_torques": (0.1, 0.2, 0.3)},
        {"robot": STEEP, "virtual_torques": (0.2, 0.2, 0.3), "mapping": "as_printed"},
    ),
    "wheel_to_virtual_torques": (
        bb.wheel_to_virtual_torques,
        {"robot": PAPER, "wheel_torques": (0.1, 0.2, 0.3)},
        {"robot": STEEP, "wheel_torques": (0.2, 0.2, 0.3)},
    ),
    "load_events": (bb.load_events, {"name_or_path": "mild"}, {"name_or_path": "hard"}),
    "load_actuators": (bb.load_actuators, {"name_or_path": "ideal"}, {"name_or_path": "kugle"}),
    "load_sensors": (bb.load_sensors, {"name_or_path": "exact"}, {"name_or_path": "kugle"}),
    "load_scenarios": (bb.load_scenarios, {}, {"path": None}),
    "OnnxPolicy": (
        lambda **given: bb.OnnxPolicy(**given).act(np.zeros(16, np.float32)),
        {"path": ASSETS / "policies" / "balance.onnx"},
        {"path": ASSETS / "policies" / "push.onnx", "task": Refused("velocity")},
    ),
    "BallbotEnv": (
        functools.partial(_front_end, lambda **given: bb.BallbotEnv(**{"model": "contact", **given})),
        {},
        {
            "task": "velocity",
            "render_mode": With("rgb_array", width=16, height=16),
            "width": With(20, render_mode="rgb_array", height=16),
            "height": With(20, render_mode="rgb_array", width=16),
            "camera": With({"distance": 2.0}, render_mode="rgb_array", width=16, height=16),
            "render_options": With({"samples": 2}, render_mode="rgb_array", width=16, height=16),
        },
    ),
    "BallbotVectorEnv": (
        functools.partial(_front_end, lambda **given: bb.BallbotVectorEnv(**{"model": "contact", **given})),
        {"max_episode_steps": 5},
        {
            "num_envs": 2,
            "task": "velocity",
            "render_mode": With("rgb_array", width=16, height=16),
            "width": With(20, render_mode="rgb_array", height=16),
            "height": With(20, render_mode="rgb_array", width=16),
            "camera": With({"distance": 2.0}, render_mode="rgb_array", width=16, height=16),
            "render_options": With({"samples": 2}, render_mode="rgb_array", width=16, height=16),
            "autoreset_mode": "same_step",
            "num_threads": Same(2),
            "seed": 5,
        },
    ),
    "Batch": (
        lambda num_envs=2, task="balance", **given: episodes_of(num_envs, task, **given),
        {},
        {
            "num_envs": 3,
            "task": "velocity",
            "autoreset": "next_step",
            "num_threads": Same(2),
            "seed": 4,
            "stage": Stage(bb.Batch(1), 2, functions={"reward": {"heading": lambda robots: robots.yaw}}),
        },
    ),
    "Reference.hold": (bb.Reference.hold, {"position": (0.1, 0.0)}, {"position": (0.2, 0.0)}),
    "Reference.line": (
        bb.Reference.line,
        {"goal": (0.3, 0.0), "seconds": 4.0},
        {"goal": (0.2, 0.0), "seconds": 5.0, "start": (0.1, 0.0)},
    ),
    "Reference.path": (
        bb.Reference.path,
        {"points": [(0.0, 0.0), (0.2, 0.1)], "times": [0.0, 4.0]},
        {"points": [(0.0, 0.0), (0.1, 0.1)], "times": [0.0, 5.0]},
    ),
    "Reference.stops": (
        bb.Reference.stops,
        {"points": [(0.0, 0.0), (0.2, 0.1)], "times": [0.0, 4.0]},
        {"points": [(0.0, 0.0), (0.1, 0.1)], "times": [0.0, 5.0]},
    ),
    "Reference.square": (bb.Reference.square, {"side": 0.3, "seconds": 4.0}, {"side": 0.2, "seconds": 5.0}),
    "Reference.velocities": (
        bb.Reference.velocities,
        {"velocities": [(0.1, 0.0)], "times": [0.0], "change": 2.0},
        {"velocities": [(0.0, 0.1)], "times": [1.0], "change": 3.0},
    ),
    "Reference.circle": (
        bb.Reference.circle,
        {"radius": 0.3, "period": 8.0},
        {"radius": 0.2, "period": 9.0, "start": 5.0},
    ),
    "Reference.lemniscate": (
        bb.Reference.lemniscate,
        {"size": 0.3, "period": 12.0},
        {"size": 0.2, "period": 13.0, "start": 5.0},
    ),
    "Reference.attitude": (
        bb.Reference.attitude,
        {"lean": 0.03, "frequency": 0.3},
        {"lean": 0.02, "frequency": 0.2, "start": 5.0},
    ),
    "Terrain.plane": (bb.Terrain.plane, {"slope": 0.1}, {"slope": 0.2, "direction": 0.3}),
    "Terrain.from_heights": (
        bb.Terrain.from_heights,
        {"heights": 0.01 * np.add.outer(np.arange(80), np.arange(90.0)), "cell": 0.1},
        {"heights": np.zeros((80, 90)), "cell": 0.11},
    ),
    "Terrain.from_function": (
        bb.Terrain.from_function,
        {"height": lambda x, y: 0.05 * np.sin(x) * np.cos(y), "size": (8.0, 8.0), "cell": 0.1},
        {"height": lambda x, y: 0.05 * np.cos(x) * np.cos(y), "size": (7.9, 8.0), "cell": 0.3},
    ),
    "Terrain.generate": (
        functools.partial(bb.Terrain.generate, size_x=8.0, size_y=8.0, cell=0.05),
        {"kind": "noise"},
        {"kind": "mix", "seed": 3},
    ),
    "read_terrain": (_read, {"path": BOWL, "cell": 0.05, "height": 0.1}, {"path": GENTLE, "cell": 0.06, "height": 0.2}),
    "write_terrain": (
        functools.partial(_written, bb.write_terrain),
        {"terrain": BOWL, "path": "a.png"},
        {"terrain": GENTLE, "path": "a.stl", "cell": 0.02},
    ),
    "write_urdf": (
        functools.partial(_written, bb.write_urdf),
        {"robot": "paper", "path": "a.urdf"},
        {"robot": "kugle", "path": None, "part": "bot"},
    ),
    "register": (lambda **_: None, {}, {"env_id": None, "task": None}),
    "identify": (
        functools.partial(_identify, bb.identify),
        {"log": 0, "fields": ["body_mass"], "sim_dt": 0.005},
        {
            "log": 1,
            "robot": PAPER.replace(body_com_height=0.36),
            "fields": ["body_com_height"],
            "actuators": {"delay": 0.002},
            "model": "spatial",
            "sim_dt": 0.01,
            "window": 0.4,
            "imu_position": (0.0, 0.0, 0.01),
            "noise": {"wheel_angle": 1e-3, "gyro": 0.02, "acceleration": 0.2},
            "rejection": 1.0,
            "num_threads": Same(2),
            "progress": "messages",
        },
    ),
    "replay": (
        functools.partial(_replay, bb.replay),
        {"log": 0},
        {
            "log": 1,
            "robot": PAPER.replace(body_com_height=0.36),
            "actuators": {"delay": 0.002},
            "model": "spatial",
            "sim_dt": 0.01,
            "window": 0.4,
            "imu_position": (0.0, 0.0, 0.01),
            "num_threads": Same(2),
            "progress": "messages",
        },
    ),
    "Estimator": (
        _estimated,
        {},
        {"robot": "kugle", "sensors": {"gyro_noise": 0.1}, "control_dt": 0.02},
    ),
    "linearize": (
        bb.linearize,
        {},
        {
            "robot": "kugle",
            "state": bb.State.at_rest(PAPER, tilt=(0.1, 0.0)),
            "wheel_torques": (0.1, 0.0, 0.0),
            "dt": 0.02,
            "sim_dt": 0.002,
        },
    ),
    "optimize_trajectory": (
        functools.partial(_progress, _optimized),
        {"goal": (0.2, 0.0), "seconds": 1.4, "control_dt": 0.02},
        {
            "goal": (0.1, 0.1),
            "robot": "kugle",
            "start": bb.State.at_rest(PAPER, tilt=(0.02, 0.0)),
            "seconds": 1.5,
            "terrain": bb.Terrain.plane(0.02),
            "initial": bb.Lqr(PAPER, control_dt=0.02),
            "friction": 0.2,
            "max_torque": 0.1,
            "control_dt": 0.01,
            "sim_dt": 0.002,
            "iterations": 2,
            "tolerance": 0.5,
            "progress": "messages",
        },
    ),
    "tune": (
        functools.partial(_progress, bb.tune),
        {"controller": "lqr", "scenarios": TILTED, "budget": 3},
        {
            "controller": "lqi",
            "scenarios": SHORTER,
            "budget": 4,
            "options": ["position"],
            "baseline": "lqi",
            "robot": "kugle",
            "model": "rigid",
            "seed": 1,
            "num_threads": Same(2),
            "progress": "messages",
        },
    ),
    "save": (lambda **_: None, {}, {"model": None, "path": None}),
}
#: Keywords of every motion, and their other values.
MOTION = {
    # For a ball at rest, the torque of the turning.
    "robot": With("kugle", yaw_rate=0.5),
    "yaw": 0.3,
    "yaw_rate": 0.2,
    "friction": With(0.01, yaw_rate=3.0),
}
#: What an error has in place of the keyword: the fraction of friction that a motion may use, the id of a task.
NAMED = {"friction": "but 0.01 is allowed", "task": "ballbot/Velocity-v0"}
#: Records, wrappers, exceptions and what is called like another: what they take is what they give, or in another test.
NOT_CALLED = {
    *("ControllerInfo", "IdentifiedParams", "Metrics", "Outcome", "Result", "Robots", "Scale", "Scenario", "SensorLog"),
    *("Dataset", "Replay", "Rollout", "Study", "CostInfo", "SafetyEnv"),
    *("Trajectory", "Tuned", "Task", "Contacts", "Terrain", "Reference", "Params"),
    *("GroupedObservations", "GroupedVectorObservations", "GroupedVecEnv", "BallbotVecEnv"),
    # tests/viewer calls them.
    *("show", "Page", "show_crowd", "CrowdPage"),
    # tests/link and tests/deployment call them.
    *("Link", "LinkPeer", "LinkFaults", "EstimatedController", "Supervised", "NativeLaw", "StateFeedback"),
    *("BallbotError", "ControllerError", "DivergedError", "InvalidInputError", "UrdfError"),
    *("evaluate", "controllers", "terrain_kinds", "obstacle_kinds", "OptimizedTrajectory", "TimeVaryingLqr"),
    *("DifferentiableBatch", "DifferentiableJaxBatch"),
    *(f"{name}{kind}" for kind in ("Env", "VectorEnv") for name in (
        "Balance", "Velocity", "Goal", "Path", "Push", "Carry", "Navigate", "Ride", "Terrain", "OpenBallBot")),
}  # fmt: skip


def episodes_of(num_envs: int, task: str, **options: Any) -> list[Any]:
    """As `episodes`, with the named arguments of `Batch`."""
    batch = bb.Batch(num_envs, task, **{"model": "contact", "max_episode_steps": 5, **options})
    found = [batch.reset()]
    for step in range(12):
        found += batch.step(np.full((num_envs, 3), 0.3 * (-1) ** step))
    return found


def _named(function: Callable[..., Any]) -> list[str]:
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [p.name for p in inspect.signature(function).parameters.values() if p.kind in kinds]


def _public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Everything with keywords: functions and constructors, by name."""
    for name in bb.__all__:
        thing = getattr(bb, name, None)
        if callable(thing) and name not in NOT_CALLED:
            yield name, thing
    for owner in (bb.Reference, bb.Terrain):
        for name, method in vars(owner).items():
            if isinstance(method, staticmethod):
                yield f"{owner.__name__}.{name}", getattr(owner, name)


@pytest.mark.slow("all keywords")
@pytest.mark.parametrize("name", sorted(CALLS))
def test_keywords_of_functions_and_constructors(name):
    call, base, keywords = CALLS[name]
    if name.startswith("Reference."):
        keywords = {**keywords, **MOTION}
    found = []
    for keyword, value in keywords.items():
        if value is not None:
            found.append(changes(call, keyword, [value], base, NAMED.get(keyword)))
    assert not [wrong for wrong in found if wrong]


def test_every_keyword_is_listed():
    missing = {}
    public = dict(_public())
    for name, function in public.items():
        listed = {*CALLS.get(name, (None, {}, {}))[2], *(MOTION if name.startswith("Reference.") else ())}
        if new := set(_named(function)) - listed:
            missing[name] = new
    assert not missing
    assert set(CALLS) <= set(public)


def test_a_dead_keyword_would_be_found():
    def call(a=1.0, b=2.0):  # noqa: ARG001
        return a

    assert changes(call, "a", [2.0], {}) is None
    assert changes(call, "b", [1.0, 3.0], {}) == "b changes nothing, tried [1.0, 3.0]"
    assert changes(call, "b", [Refused(1.0)], {}) == "b = 1.0 is not rejected"

    def rejects(c=0):
        if c:
            raise ValueError("no")

    assert changes(rejects, "c", [1], {}) == "c = 1 is rejected without its name: no"
