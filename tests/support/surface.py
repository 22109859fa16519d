"""The public Python surface: everything that can be called, with valid and invalid arguments."""

import ast
import functools
import inspect
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import ballbot_rs as bb
from ballbot_rs._core import INSTRUMENTS
from tests.support.paths import ASSETS, ROBOTS

#: Functions that are not called here, and why.
LEFT_OUT = {
    "compare": "as evaluate",
    "evaluate": "thousands of steps a call; tests/analysis has its bad input",
    "save": "writes files; tests/control has its bad input",
    "OnnxPolicy": "reads files of another library; tests/control has its bad input",
    "BallbotVecEnv": "needs PyTorch; it has the batch of the other front ends",
    "IdentifiedParams": "a plain record",
    "Result": "a plain record",
    "Study": "a plain record",
    "Dataset": "a plain record",
    "record_dataset": "episodes a call; tests/analysis has its bad input",
    "CostInfo": "a wrapper; tests/envs has it",
    "SafetyEnv": "as CostInfo",
    "Rollout": "a plain record",
    "rollout": "many steps a call; tests/analysis has its bad input",
    "SensorLog": "reads and writes files; tests/identification has its bad input",
    "identify": "seconds a call; tests/identification has its bad input",
    "record_log": "as identify",
    "replay": "as identify",
    "Replay": "a plain record",
    "optimize_trajectory": "seconds a call; tests/optimal has its bad input",
    "OptimizedTrajectory": "a plain record",
    "DifferentiableBatch": "needs PyTorch; tests/optimal has its bad input",
    "DifferentiableJaxBatch": "needs JAX; as DifferentiableBatch",
    "TimeVaryingLqr": "made by OptimizedTrajectory.law; tests/optimal has it",
    "Trajectory": "a plain record; tests/analysis has its files",
    "Metrics": "a plain record",
    "ControllerInfo": "a plain record",
    "estimator_constants": "for the export to C; tests/deployment has its bad input",
    "reading_bounds": "for the spaces of environments, whose options are called with anything",
    "Link": "opens a line; tests/link has its bad input",
    "LinkPeer": "as Link",
    "LinkFaults": "a plain record; tests/link has its bad input",
    "Supervised": "compiles C; tests/deployment has its bad input",
    "StateFeedback": "tests/control has its bad input",
    "NativeLaw": "calls C; tests/deployment has its bad input",
    "EstimatedController": "an estimator and a law; tests/link has its bad input",
    "Outcome": "a plain record",
    "Tuned": "a plain record",
    "Scale": "closed forms of Params; tests/scenarios has them",
    "Scenario": "data; tests/scenarios has its bad input",
    "load_scenarios": "reads files; tests/scenarios has its bad input",
    "run_scenarios": "thousands of steps a call; tests/scenarios has its bad input",
    "tune": "as run_scenarios",
    "Task": "a base class; tests/envs has what its methods may return",
    "Robots": "the input of tasks in Python; made only by the package",
    "read_terrain": "reads files; tests/media has its bad input",
    "write_terrain": "writes files; tests/media has its bad input",
    "write_urdf": "as write_terrain",
    "_contacts_of": "what pickle calls",
    "_terrain_of": "what pickle calls",
    "_policy_controller": "behind OnnxPolicy.controller; tests/control has its bad input",
    "_params_of": "behind every argument `robot`, which is called with anything",
    "_toml_table": "the parser behind load_scenarios; tests/scenarios has its bad input",
    "show": "serves a page; tests/viewer has its bad input",
    "Page": "as show",
    "show_crowd": "as show",
    "CrowdPage": "as show",
    "register": "changes what is registered; tests/envs has its bad input",
    **{
        f"{name}VectorEnv": f"as {name}Env"
        for name in ("Velocity", "Goal", "Path", "Push", "Carry", "Navigate", "Ride", "Terrain", "OpenBallBot")
    },
    "GroupedObservations": "a wrapper; tests/envs has it",
    "GroupedVectorObservations": "as GroupedObservations",
    "GroupedVecEnv": "as GroupedObservations",
    "ControllerError": "an exception",
    "BallbotError": "an exception",
    "DivergedError": "an exception",
    "InvalidInputError": "an exception",
    "UrdfError": "an exception",
}


def class_name(task: str) -> str:
    """Prefix of the classes of a task."""
    return bb._core.TASKS[task]["id"].removeprefix("ballbot/").removesuffix("-v0")


#: Numbers at the edges of their types.
FLOATS = [0.0, -0.0, 1.0, -1.0, 0.5, float("nan"), float("inf"), -float("inf"), 5e-324, -5e-324, 1e-300, 1e-30, 1e-9]
FLOATS += [1e9, 1e10, 1e16, 1e155, -1e155, 1e300, 1.7e308, np.pi, -np.pi]
#: Below, and far beyond the range of any count: a valid count, such as a billion steps, takes its time.
INTEGERS = [-(2**70), -(2**63) - 1, -(2**31), -1, 0, 1, 2, 3, 2**63, 2**64, 10**30, 10**400]


class Broken:
    """Raises on any access."""

    def __float__(self):
        raise ZeroDivisionError("no number")

    def __index__(self):
        raise ZeroDivisionError("no index")

    def __array__(self, *_args, **_kwargs):
        raise ZeroDivisionError("no array")

    def __len__(self):
        raise ZeroDivisionError("no length")


def _masked():
    return np.ma.masked_array(np.ones(3), mask=[True, False, False])


#: Objects of every kind, created for each call.
OBJECTS: list[Callable[[], Any]] = [
    *(
        functools.partial(lambda value: value, value)
        for value in (None, True, False, "", "x", "1.0", "nan", "\0", b"1")
    ),
    *(functools.partial(lambda value: value, value) for value in ("paper", "planar", "contact", "x.toml", 1j, ...)),
    object,
    Broken,
    list,
    dict,
    set,
    lambda: [[]],
    lambda: [None] * 3,
    lambda: ["1", "2", "3"],
    lambda: [1, [2, 3]],
    lambda: {"a": 1},
    lambda: range(3),
    lambda: (i for i in range(3)),
    lambda: int,
    lambda: Decimal("0.1"),
    lambda: Fraction(1, 3),
    lambda: np.float32(0.1),
    lambda: np.int8(1),
    lambda: np.timedelta64(1, "s"),
    lambda: np.datetime64("2020-01-01"),
    lambda: np.zeros(0),
    lambda: np.array(0.5),
    _masked,
    lambda: bb.State([0, 0, 1]),
    bb.Params.paper,
    bb.Lqr,
    bytes,
    lambda: bytes(1000),
]

#: Shapes of arrays: valid for some argument, and others.
SHAPES = [(), (0,), (1,), (2,), (3,), (4,), (5,), (6,), (10,), (32,), (0, 3), (1, 3), (2, 3), (3, 2), (2, 32), (10, 10)]
SHAPES += [(3, 3), (1, 1, 3), (2, 2, 3)]
#: Their types: real, and others.
DTYPES = ["f8", "f4", "f2", "g", ">f8", "i4", "u8", "?", "c16", "O", "U5", "S5", "m8[s]", "M8[s]"]


def array(shape: tuple[int, ...], dtype: str, value: float, order: str) -> np.ndarray:
    """An array filled with `value`, as far as its type allows."""
    with np.errstate(all="ignore"):
        try:
            filled = np.full(shape, value).astype(dtype)
        except (ValueError, OverflowError):
            filled = np.ones(shape).astype(dtype)
    if order == "strided":
        return np.repeat(filled, 2, axis=-1)[..., ::2] if filled.ndim else filled
    return np.asarray(filled, order=order)


def _robot(model: str = "spatial") -> bb.Ballbot:
    robot = bb.Ballbot(model=model)
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.05, 0.0)))
    return robot


def _crowd() -> bb.Crowd:
    return bb.Crowd(["paper", "kugle"], [(0.0, 0.0), (1.0, 0.0)])


def _batch(model: str = "spatial", task: str = "balance") -> bb.Batch:
    batch = bb.Batch(2, task, model=model, num_threads=1)
    batch.reset()
    return batch


def _environment(task: str = "balance") -> bb.BallbotEnv:
    # Their own ground takes a second to generate.
    options = {"terrain": {"kind": "wave", "size_x": 8.0, "size_y": 8.0}} if task in ("terrain", "openballbot") else {}
    env = bb.BallbotEnv(task, model="contact", **options)
    env.reset(seed=0)
    return env


def _vector_environment() -> bb.BalanceVectorEnv:
    env = bb.BalanceVectorEnv(2, model="contact", num_threads=1)
    env.reset(seed=0)
    return env


#: Objects of each class, whose methods are called.
INSTANCES: dict[str, list[Callable[[], Any]]] = {
    "Params": [bb.Params.paper],
    "State": [lambda: bb.State.at_rest(bb.Params.paper(), tilt=(0.05, 0.0))],
    "Contacts": [lambda: _robot().contacts],
    "Ballbot": [functools.partial(_robot, model) for model in ("planar", "spatial", "contact", "rigid")],
    "Crowd": [_crowd],
    "Terrain": [
        lambda: bb.Terrain.plane(0.1),
        lambda: bb.Terrain.generate("wave", size_x=1.0, size_y=1.0, cell=0.1),
    ],
    "Batch": [
        *(functools.partial(_batch, model) for model in ("planar", "spatial", "contact", "rigid")),
        functools.partial(_batch, "contact", "goal"),
    ],
    "SpatialModel": [lambda: bb.SpatialModel(bb.Params.paper())],
    "PlanarModel": [lambda: bb.PlanarModel(bb.Params.paper())],
    "LinearModel": [bb.LinearModel],
    "Jacobian": [lambda: bb.Ballbot().jacobian([0.1, 0.0, 0.0], 2, ["body_mass"])],
    "Jacobians": [lambda: bb.Batch(2).jacobians(np.zeros((2, 3)))],
    "MotionJacobians": [lambda: bb.Ballbot().jacobians(np.zeros((2, 3)), 2, ["body_mass"])],
    "Controller": [lambda: bb.Controller("lqr")],
    "Pid": [bb.Pid],
    "Lqr": [bb.Lqr],
    "Estimator": [bb.Estimator],
    "Renderer": [lambda: bb.Renderer(width=8, height=8, num_threads=1)],
    "BallbotEnv": [_environment],
    **{f"{class_name(task)}Env": [functools.partial(_environment, task)] for task in bb._core.TASKS},
    "BalanceVectorEnv": [_vector_environment],
    "BallbotVectorEnv": [_vector_environment],
    "Push": [lambda: bb.Push((0.1, 0, 0), duration=0.1)],
    "Reference": [lambda: bb.Reference.hold((0.1, 0.0))],
    "Force": [lambda: bb.Force((0.1, 0, 0))],
    "Setpoint": [bb.Setpoint],
}


def _forged(snapshot: bytes, count: int) -> Iterator[bytes]:
    """Snapshots with some bytes changed, and valid checksums."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        data = bytearray(snapshot[:-4])
        for place in rng.integers(6, len(data), rng.integers(1, 9)):
            data[place] = rng.choice([0, 1, 0x7F, 0x80, 0xF0, 0xFF, rng.integers(256)])
        yield bytes(data) + zlib.crc32(data).to_bytes(4, "little")


def _snapshots(made: list[Any], *index: int) -> list[bytes]:
    own = [thing.snapshot(*index) for thing in made]
    # A snapshot of `rigid` is a rapier world, and rapier trusts it.
    ours = [snapshot for thing, snapshot in zip(made, own, strict=True) if thing.model != "rigid"]
    return own + [forged for snapshot in ours for forged in _forged(snapshot, 100)]


_PAPER = bb.Params.paper().to_dict()
#: Valid values of arguments by name; "class.argument" or "class.method.argument" takes precedence over "argument".
RIGHT: dict[str, list[Any]] = {
    **{name: [value] for name, value in _PAPER.items()},
    "params": [bb.Params.paper(), "kugle"],
    "robot": [None, bb.Params.paper(), "kugle", bb.Params.preset("rezero").to_dict()],
    "pushes": [(), bb.Push((0.1, 0, 0), 0.01), [bb.Push((0.1, 0, 0), 0.01)]],
    "model": ["planar", "spatial", "contact", "rigid"],
    "sim_dt": [0.001, 0.002],
    "control_dt": [0.01, 0.004],
    "state": [bb.State.at_rest(bb.Params.paper(), tilt=(0.05, 0.0))],
    "reset.state": [None, bb.State.at_rest(bb.Params.paper())],
    "wheel_torques": [[0.1, 0.0, -0.1]],
    "virtual_torques": [[0.1, 0.0, -0.1]],
    "virtual_torque": [0.1],
    "impulse": [[0.1, 0.0, 0.0]],
    "point": [None, [0.0, 0.0, 0.2]],
    "payloads": [np.zeros((2, 6)), np.zeros((2, 2, 6))],
    "steps": [0, 1, 10],
    "motion": [lambda states, _: states],
    "parameters": [None, ["body_mass"], ["body_com_offset[0]", "body_inertia"]],
    "Ballbot.jacobian.steps": [1, 10],
    "Ballbot.jacobians.steps": [1, 10],
    "Ballbot.jacobians.wheel_torques": [np.zeros((2, 3))],
    "Batch.jacobians.steps": [1, 10],
    "Batch.jacobians.wheel_torques": [np.zeros((2, 3))],
    "MotionJacobians.jvp.state": [None, np.ones(30)],
    "MotionJacobians.jvp.torques": [None, np.ones((2, 3))],
    "MotionJacobians.jvp.parameters": [None, [1.0]],
    "MotionJacobians.vjp.states": [np.ones((2, 30))],
    "Ballbot.restore.snapshot": _snapshots([make() for make in INSTANCES["Ballbot"]]),
    "Batch.restore.snapshot": _snapshots([make() for make in INSTANCES["Batch"]], 0),
    "Ballbot.__setstate__.snapshot": _snapshots([make() for make in INSTANCES["Ballbot"]]),
    "Crowd.restore.snapshot": [_crowd().snapshot()],
    "Crowd.__setstate__.snapshot": [_crowd().snapshot()],
    "Crowd.robots": [["paper", "kugle"], [bb.Params.paper(), "rezero"]],
    "positions": [[(0.0, 0.0), (1.0, 0.0)]],
    "restitution": [0.0, 0.2],
    "Crowd.friction": [0.0, 0.5],
    "Crowd.step.wheel_torques": [np.zeros((2, 3))],
    "Crowd.reset.states": [None, _crowd().states],
    "Crowd.push.robot": [0, 1],
    "Crowd.apply_force.robot": [0, 1],
    "of": [0],
    "on": [1],
    "restore.index": [0, 1],
    "index": [0, 1],
    "body_quaternion": [[1.0, 0, 0, 0]],
    "ball_quaternion": [[1.0, 0, 0, 0]],
    "generalized_velocity": [[0.1] * 6],
    "q": [[0.0, 0.1]],
    "q_dot": [[0.1, 0.1]],
    "dt": [0.01],
    "mapping": ["consistent", "as_printed"],
    "Controller.name": [*bb._core.CONTROLLERS],
    "perceived.name": [*INSTRUMENTS],
    "name": ["kugle"],
    "max_torque": [None, 0.1],
    "max_wheel_torque": [1.0],
    "Params.max_wheel_torque": [5.0],
    "State.rolling.params": [bb.Params.paper()],
    "State.at_rest.params": [bb.Params.paper()],
    "State.at_equilibrium.params": [bb.Params.paper()],
    "SpatialModel.params": [bb.Params.paper()],
    "PlanarModel.params": [bb.Params.paper()],
    "virtual_to_wheel_torques.params": [bb.Params.paper()],
    "wheel_to_virtual_torques.params": [bb.Params.paper()],
    "State.rolling.ball_velocity": [[0.1, 0.0]],
    "get_attr.name": ["params"],
    "set_attr.name": ["note"],
    "call.name": ["states"],
    "position": [[0.1, 0.0]],
    "velocity": [[0.1, 0.0]],
    "tilt": [[0.01, 0.0]],
    "yaw": [0.3],
    "num_envs": [1, 2, 9],
    "task": [*bb._core.TASKS],
    "command": [[0.1, 0.2]],
    "autoreset": ["same_step", "next_step", "disabled"],
    "num_threads": [None, 1, 2],
    "seed": [0, 7],
    "mask": [None, np.array([True, False])],
    "seeds": [None, [1, 2]],
    "starts": [None, [None, None]],
    "actions": [np.zeros((2, 3), np.float32)],
    "action": [np.zeros(3, np.float32)],
    "controller": [bb.Lqr()],
    "setpoints": [None, {"position": [0.1, 0.0]}],
    "record": [["states"], ["states", "rewards", "floor_force"], []],
    "values": [bb.State([0, 0, 1]).to_array()],
    "ball_position": [[0.0, 0.0, 0.112]],
    "ball_spin": [0.1],
    "wheel_angles": [[0.0] * 3],
    "wheel_speeds": [[0.0] * 3],
    "width": [8],
    "height": [8],
    "samples": [1, 2, 4],
    "camera": [None, {"distance": 1.0}],
    "urdf": [None],
    "contacts": [None],
    "arrows": [None, np.zeros((2, 2, 3))],
    "states": [np.tile(bb.State([0, 0, 1]).to_array(), (2, 1))],
    "wheel_inertia": ["as_printed"],
    "Params.wheel_inertia": [_PAPER["wheel_inertia"]],
    "plane": ["xz", "yz"],
    "absolute_wheel_spin": [True, False],
    "ball_spins_about_vertical": [True, False],
    "text_or_path": [bb.Params.paper().to_toml()],
    "bot_path": [ASSETS / "bot.urdf"],
    "ball_path": [ASSETS / "ball.urdf"],
    "Q": [None, np.ones(10), np.eye(10)],
    "R": [None, np.ones(3)],
    "options": [None],
    "render_mode": [None, "rgb_array"],
    "reward": [{"tilt": 2.0}],
    "actuators": [None, "ideal", {"delay": 0.004, "lag": 0.01}, {"stall_torque": 0.5, "no_load_speed": 50.0}],
    "load_actuators.name_or_path": ["ideal", "kugle", ROBOTS / "kugle.toml"],
    "sensors": [None, "exact", {"gyro_noise": 0.01, "latency": 0.0}, {"encoder_ticks": 4096, "imu_misalignment": 0.01}],
    "load_sensors.name_or_path": ["exact", "kugle", ROBOTS / "kugle.toml"],
    "scan": [None, {}, {"points": (3, 2), "noise": 0.01, "latency": 0.0}],
    "depth": [None, {"size": (4, 3), "freeze": 0.5}],
    "lidar": [None, {"beams": 5, "noise": 0.01, "stabilized": 1}],
    "level": [None],
    "observation": ["ground_truth", "sensors"],
    "history": [1, 3, [0, 2, 5]],
    "events": [None, "mild", {"term": "gravity", "range": [9.0, 10.0]}, [{"term": "push", "range": [0, 1], "at": 0.0}]],
    "load_events.name_or_path": ["mild", "hard", [{"term": "body_mass", "op": "scale", "range": [0.9, 1.1]}]],
    "Estimator.update.readings": [
        {"gyro": [0.0] * 3, "specific_force": [0.0, 0.0, 9.81], "wheel_angles": [0.0] * 3},
        {"gyro": [1e8] * 3, "specific_force": [9e8] * 3, "wheel_angles": [1e9] * 3, "wheel_rates": [-1e9] * 3},
    ],
    "setpoint": [(0.1, 0.0)],
    "max_episode_steps": [10, None],
    "scale_observations": [True, False],
    "other": [None],
    "attr_name": ["params"],
    "seconds": [0.05],
    "Push.impulse": [(0.1, 0.0, 0.0)],
    "Force.force": [(0.1, 0.0, 0.0)],
    "simulate.reference": [None, {"position": (0.1, 0.0)}, bb.Reference.hold((0.1, 0.0))],
    "simulate.pushes": [(), [bb.Push((0.1, 0, 0), 0.01, 0.02)]],
    "simulate.forces": [(), [bb.Force((0.1, 0, 0))]],
    "simulate.robot": [None, "kugle"],
    "linearize.robot": [None, "kugle"],
    "simulate.start": [None, bb.State.at_rest(bb.Params.paper())],
    "simulate.position": [None, (0.1, 0.0)],
    "begin": [0.0],
    "end": [None, 0.04],
    "duration": [0.0, 0.02],
    "time": [0.01],
    "terrain": [None, bb.Terrain.plane(0.1), "wave", {"kind": "noise", "size_x": 1.0, "size_y": 1.0}],
    "kind": [*bb.terrain_kinds()],
    "slope": [0.1],
    "direction": [0.3],
    "heights": [np.zeros((5, 6))],
    "cell": [0.1],
    "Terrain.from_function.height": [lambda x, _: 0.1 * x],
    "size": [(1.0, 2.0)],
    "x": [0.1, np.array([0.1, 0.2])],
    "y": [0.2],
    "fall_tilt": [0.3],
}
RIGHT |= {"PushEnv.push": [(0.1, 0.5)], "BallbotEnv.push": [(0.1, 0.5)], "Batch.push": [(0.1, 0.5)]}
#: Keyword arguments that a signature does not list.
_FLOATING = {option["name"]: [option["default"]] for task in bb._core.TASKS.values() for option in task["options"]}
_COMMON = [
    "model",
    "sim_dt",
    "control_dt",
    "max_wheel_torque",
    "max_episode_steps",
    "actuators",
    "sensors",
    *INSTRUMENTS,
    "level",
    "observation",
    "history",
    "reward",
    "events",
    "terrain",
]
#: Of everything that simulates robots in environments.
_ENVIRONMENT = ["robot", *_COMMON, *_FLOATING]
_STATE = ["ball_velocity", "ball_angular_velocity", "body_quaternion", "body_position", "wheel_speeds"]
OPEN: dict[str, list[str]] = {
    "Params": list(_PAPER),
    "Params.replace": list(_PAPER),
    "Terrain.generate": ["slope", "cell", "wavelength", "apron"],
    "State.replace": _STATE,
    "Controller": ["position", "proportional", "integral"],
    "Pid": [option["name"] for option in bb._core.CONTROLLERS["pid"]["options"]],
    "Lqr": [option["name"] for option in bb._core.CONTROLLERS["lqr"]["options"]],
    "Controller.__call__": ["position", "velocity", "yaw"],
    "Pid.__call__": ["tilt"],
    "Lqr.__call__": ["position", "velocity", "yaw"],
    "Batch": ["robot", *_ENVIRONMENT[1:]],
    **{
        f"{class_name(name)}Env": ["robot", *_COMMON, *(option["name"] for option in task["options"])]
        for name, task in bb._core.TASKS.items()
    },
    "BallbotEnv": _ENVIRONMENT,
    "BalanceVectorEnv": _ENVIRONMENT,
    "BallbotVectorEnv": _ENVIRONMENT,
    **{name: ["robot", *_COMMON] for name in ("simulate", "rollout", "compare", "evaluate", "record_dataset")},
}
#: Weights and gains are single numbers where the part of a setpoint with the same name has two.
SCALAR = {f"{owner}.{name}": [1.0] for owner in ("Pid", "Lqr", "Controller") for name in OPEN[owner]}


@dataclass(frozen=True)
class Target:
    """Something that can be called."""

    name: str
    function: Callable[..., Any]
    #: Names of the arguments, and whether each must be given.
    arguments: tuple[tuple[str, bool], ...]
    instances: tuple[Callable[[], Any], ...] = ()

    def right(self, argument: str) -> list[Any]:
        """Valid values of an argument."""
        owner, _, method = self.name.partition(".")
        keys = (f"{self.name}.{argument}", f"{method}.{argument}", argument)
        if not method and f"{owner}.{argument}" in SCALAR:
            return SCALAR[f"{owner}.{argument}"]
        found = next((RIGHT[key] for key in keys if key in RIGHT), None)
        return found or RIGHT.get(argument) or _FLOATING.get(argument) or [[0.0, 0.0, 0.0]]


#: Special methods that users call by other syntax, as functions of its operands.
SPECIAL: dict[str, tuple[Callable[..., Any], tuple[tuple[str, bool], ...]]] = {
    "__call__": (lambda self, **arguments: self(**arguments), (("state", True),)),
    "__eq__": (lambda self, other: self == other, (("other", True),)),
    "__setstate__": (lambda self, snapshot: self.__setstate__(snapshot), (("snapshot", True),)),
}


def _arguments(name: str, function: Callable[..., Any], *, bound: bool) -> tuple[tuple[str, bool], ...]:
    parameters = list(inspect.signature(function).parameters.values())[1 if bound else 0 :]
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = [(p.name, p.default is inspect.Parameter.empty) for p in parameters if p.kind not in kinds]
    # Most parameters have no default.
    return (*named, *((extra, name == "Params") for extra in OPEN.get(name, ()) if extra not in dict(named)))


def _methods(owner: type) -> Iterator[str]:
    module = "ballbot_rs"
    for name in sorted(dir(owner)):
        if name.startswith("_") and name not in SPECIAL:
            continue
        attribute = inspect.getattr_static(owner, name)
        defined = next(base for base in owner.__mro__ if name in vars(base))
        if defined is object or not (defined.__module__ or "").startswith(module):
            continue
        # Written in Python, it is called by pickle.
        if (
            name == "__setstate__"
            and not defined.__module__.startswith("ballbot_rs._core")
            and defined.__module__ != module
        ):
            continue
        if callable(getattr(owner, name)) and not isinstance(attribute, property):
            yield name


def targets() -> Iterator[Target]:
    """Everything that is exported."""
    for name in bb.__all__:
        thing = None if name in LEFT_OUT else getattr(bb, name)
        if not callable(thing):
            continue
        if name not in ("Contacts",):
            yield Target(name, thing, _arguments(name, thing, bound=False))
        if not inspect.isclass(thing):
            continue
        for method in _methods(thing):
            static = isinstance(inspect.getattr_static(thing, method), (staticmethod, classmethod))
            full = f"{name}.{method}"
            if method in SPECIAL:
                function, arguments = SPECIAL[method]
                arguments = (*arguments, *((extra, False) for extra in OPEN.get(full, ())))
            else:
                function = getattr(thing, method)
                arguments = _arguments(full, function, bound=not static)
            yield Target(full, function, arguments, () if static else tuple(INSTANCES[name]))


def stub_names() -> set[str]:
    """Methods and functions in the stub of the extension module, as `Class.method` or `function`."""
    tree = ast.parse((Path(bb.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
    names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for owner in (node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")):
        for node in owner.body:
            if not isinstance(node, ast.FunctionDef) or any(ast.unparse(d) == "property" for d in node.decorator_list):
                continue
            if not node.name.startswith("_") or node.name in SPECIAL:
                names.add(f"{owner.name}.{node.name}")
    return names


def numbers_that_are_not_finite(value: Any, path: str = "") -> list[str]:
    """Where a result, or a part of it, is NaN or infinite."""
    if isinstance(value, float):
        return [] if np.isfinite(value) else [f"{path} = {value}"]
    if isinstance(value, np.ndarray):
        bad = value.dtype.kind == "f" and not np.isfinite(value).all()
        return [f"{path} = {value}"] if bad else []
    if isinstance(value, (tuple, list)):
        return [w for i, part in enumerate(value) for w in numbers_that_are_not_finite(part, f"{path}[{i}]")]
    if isinstance(value, dict):
        return [w for key, part in value.items() for w in numbers_that_are_not_finite(part, f"{path}[{key!r}]")]
    found = []
    for name in _READABLE.get(type(value).__name__, ()):
        found += numbers_that_are_not_finite(getattr(value, name), f"{path}.{name}")
    if isinstance(value, bb.Batch):
        for name in ("states", "observations", "contacts", "reward_terms"):
            found += numbers_that_are_not_finite(getattr(value, name)(), f"{path}.{name}()")
    return found


#: Continues after a call, which reveals a robot that the call has broken.
THEN: dict[str, Callable[[Any], Any]] = {
    "Ballbot": lambda robot: robot.step([0, 0, 0], 2),
    "Batch": lambda batch: batch.step(np.zeros((2, 3))),
    "BalanceEnv": lambda env: env.step(np.zeros(3)),
    "BalanceVectorEnv": lambda env: env.step(np.zeros((2, 3))),
}

#: Attributes whose numbers are checked. A contact without load has no finite utilization.
_READABLE = {
    "State": ("ball_position", "tilt", "tilt_components", "yaw", "wheel_speeds", "body_quaternion"),
    "Contacts": (
        "wheel_normal_forces",
        "wheel_tractions",
        "wheel_slip_speeds",
        "floor_force",
        "bot_floor_force",
        "obstacle_force",
        "floor_slip_velocity",
    ),
    "Ballbot": ("state", "contacts", "energy", "time"),
    "LinearModel": ("A", "B"),
    "Jacobian": ("A", "B", "P", "C", "D", "Q", "state", "contacts"),
    "Jacobians": ("A", "B", "P", "C", "D", "Q", "valid", "margin", "modes_changed", "one_sided"),
    "MotionJacobians": ("A", "B", "P", "C", "D", "Q"),
    "Lqr": ("gain", "riccati_solution", "residual"),
    "BalanceEnv": ("state",),
    "BalanceVectorEnv": ("states",),
}
