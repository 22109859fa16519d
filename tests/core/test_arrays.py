"""No array that leaves the library is a way into it: each is read-only, or a copy."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.envs._batch_env import new_batch
from tests.support import surface
from tests.support.paths import ASSETS

#: Methods and attributes that are not read, and why.
NOT_READ = {
    "close": "ends an environment",
    "np_random": "random numbers of the caller",
    "render": "needs a mode; a frame is rendered again each time",
    "state_interval": "of other libraries",
}

HELD: dict[str, Any] = {}


class Keeps(bb.Task):
    """Keeps the robots that it is given."""

    def observe(self, robots):
        HELD["robots"] = robots
        return robots.gravity

    def reward(self, robots):
        return np.zeros(len(robots))


def _robots():
    bb.register("me/Keeps-v0", Keeps)
    new_batch(2, task="me/Keeps-v0", options={"model": "contact"}).reset()
    return HELD["robots"]


def _own_batch():
    bb.register("me/Keeps-v0", Keeps)
    batch = new_batch(2, task="me/Keeps-v0", seed=1, options={"model": "contact", "max_episode_steps": 3})
    batch.reset()
    for _ in range(3):
        batch.step(np.full((2, 3), 0.1))
    return batch


def _seeing(task="velocity"):
    batch = bb.Batch(
        2,
        task,
        model="contact",
        num_threads=1,
        autoreset="disabled",
        terrain="wave",
        sensors={},
        observation="sensors",
        scan={"points": (3, 2)},
        depth={"size": (4, 3)},
        lidar={"beams": 5},
        events="mild",
    )
    batch.reset()
    batch.step(np.full((2, 3), 0.1))
    return batch


def _vec_env():
    env = bb.BallbotVecEnv("balance", num_envs=2, model="contact", seed=1)
    env.reset()
    return env


@functools.cache
def _trajectory_once():
    return bb.simulate("lqr", seconds=0.1, observation="sensors", sensors={}, events="mild", task="velocity")


def _trajectory():
    return dataclasses.replace(_trajectory_once())


def _outcome():
    return dataclasses.replace(_outcome_once())


@functools.cache
def _outcome_once():
    return bb.run_scenarios("lqr", bb.Scenario("x", "", seconds=1.2, tilt=(1.0, 2.0, 1.0), score="map"))[0]


@functools.cache
def _log_once():
    return bb.record_log(seconds=1.0)


@functools.cache
def _motion_once():
    return bb.optimize_trajectory((0.05, 0.0), seconds=1.0, control_dt=0.02)


#: Objects whose arrays are tested, in addition to `surface.INSTANCES`.
MORE: dict[str, list[Callable[[], Any]]] = {
    "Batch": [_seeing, _own_batch],
    "Robots": [_robots],
    "Trajectory": [_trajectory],
    "Dataset": [lambda: bb.record_dataset("lqr", episodes=1, max_episode_steps=3)],
    "Rollout": [lambda: bb.rollout("lqr", 2, seconds=0.1)],
    "Outcome": [_outcome],
    "OptimizedTrajectory": [lambda: dataclasses.replace(_motion_once())],
    "TimeVaryingLqr": [lambda: _motion_once().law()],
    "OnnxPolicy": [lambda: bb.OnnxPolicy(ASSETS / "policies" / "balance.onnx")],
    "StateFeedback": [lambda: bb.StateFeedback(np.ones((3, 10)))],
    "SensorLog": [lambda: dataclasses.replace(_log_once())],
    "Replay": [lambda: bb.replay(bb.record_log(seconds=3.0), num_threads=1)],
    "BallbotVecEnv": [_vec_env],
    "Setpoint": [lambda: bb.Setpoint(position=np.array([0.1, 0.2]))],
    "CostInfo": [lambda: bb.CostInfo(surface._environment())],
    "GroupedObservations": [lambda: bb.GroupedObservations(surface._environment())],
}
#: Types without arrays.
WITHOUT = {
    *("ControllerInfo", "Metrics", "Result", "Study", "Tuned", "Scale", "Scenario", "Task", "IdentifiedParams"),
    # A page; its arrays are copies.
    *("Page", "CrowdPage"),
    # It copies what it is given, as tests/link compares.
    *("Link", "LinkPeer", "LinkFaults", "EstimatedController", "Supervised", "NativeLaw"),
    *("BallbotError", "ControllerError", "DivergedError", "InvalidInputError", "UrdfError"),
    # Their numbers are of PyTorch and of JAX.
    *("DifferentiableBatch", "DifferentiableJaxBatch"),
    # As others of the same class.
    *("GroupedVectorObservations", "GroupedVecEnv", "SafetyEnv"),
    *(
        f"{name}VectorEnv"
        for name in ("Velocity", "Goal", "Path", "Push", "Carry", "Navigate", "Ride", "Terrain", "OpenBallBot")
    ),
}
#: Arguments of methods that need some and that `surface` does not call.
ARGUMENTS: dict[str, dict[str, Any]] = {
    "Trajectory.of_states": {"name": "body_quaternion"},
    "Trajectory.of_estimates": {"name": "body_quaternion"},
    "Trajectory.of_contacts": {"name": "wheel_normal_forces"},
    "OnnxPolicy.act": {"observation": np.zeros((2, 16), np.float32)},
    "OnnxPolicy.step": {"observation": np.zeros((2, 16), np.float32), "state": np.zeros((2, 0), np.float32)},
    "BallbotVecEnv.step": {"actions": np.full((2, 3), 0.1, np.float32)},
    "BallbotVecEnv.env_method": {"method_name": "metrics"},
    "BallbotVecEnv.get_attr": {"attr_name": "state"},
    "GroupedObservations.step": {"action": np.full(3, 0.1, np.float32)},
    "OwnBatch.step": {"actions": np.full((2, 3), 0.1, np.float32)},
    "OwnBatch.reset": {},
}


def everything() -> dict[str, list[Callable[[], Any]]]:
    """Factories of objects by their class."""
    names = {*surface.INSTANCES, *MORE}
    return {name: [*surface.INSTANCES.get(name, []), *MORE.get(name, [])] for name in sorted(names)}


def arrays(value: Any, path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Arrays within a value, with their positions."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "O":
            yield path, value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from arrays(part, f"{path}[{key!r}]")
    elif isinstance(value, (list, tuple)):
        for i, part in enumerate(value):
            yield from arrays(part, f"{path}[{i}]")


def numbers(value: Any) -> list[tuple[str, np.ndarray]]:
    """Copies of the arrays within a value."""
    return [(path, array.copy()) for path, array in arrays(value)]


def readers(make: Callable[[], Any], name: str) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Everything that may be read of an object: attributes, and methods with right arguments."""
    thing = make()
    called = {target.name: target for target in surface.targets()}
    for attribute in sorted(dir(thing)):
        if attribute.startswith("_") or attribute in NOT_READ:
            continue
        static = inspect.getattr_static(type(thing), attribute, None)
        full = f"{name}.{attribute}"
        if not callable(static) or isinstance(static, property):
            yield full, functools.partial(lambda attribute, one: getattr(one, attribute), attribute)
            continue
        if full in ARGUMENTS:
            given = ARGUMENTS[full]
        elif full in called:
            given = {key: called[full].right(key)[0] for key, needed in called[full].arguments if needed}
            given |= {"seed": 0} if any(key == "seed" for key, _ in called[full].arguments) else {}
        else:
            try:
                needed = [p for p in inspect.signature(getattr(thing, attribute)).parameters.values() if _needed(p)]
            except (TypeError, ValueError):
                continue
            if needed:
                continue
            given = {}
        yield full, functools.partial(lambda attribute, given, one: getattr(one, attribute)(**given), attribute, given)


def _needed(parameter: inspect.Parameter) -> bool:
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return parameter.default is parameter.empty and parameter.kind not in kinds


def future(thing: Any) -> list[tuple[str, np.ndarray]]:
    """What an object does next."""
    if hasattr(thing, "step") and hasattr(thing, "num_envs"):
        return numbers(thing.step(np.full((thing.num_envs, 3), 0.2, np.float32)))
    if isinstance(thing, bb.BallbotEnv):
        return numbers(thing.step(np.full(3, 0.2, np.float32)))
    if isinstance(thing, bb.Ballbot):
        thing.step(np.full(3, 0.1), 3)
        return [("", thing.state.to_array())]
    return []


def same(one: list[tuple[str, np.ndarray]], two: list[tuple[str, np.ndarray]]) -> bool:
    """Whether arrays are equal, NaN to NaN."""
    return [path for path, _ in one] == [path for path, _ in two] and all(
        a.tobytes() == b.tobytes() for (_, a), (_, b) in zip(one, two, strict=True)
    )


def spoil(array: np.ndarray) -> None:
    """Writes into an array other numbers than it has."""
    array[...] = ~array if array.dtype.kind == "b" else array + 3 if array.dtype.kind in "iuf" else array


def leaks(make: Callable[[], Any], read: Callable[[Any], Any]) -> list[str]:
    """Arrays that are a way into an object."""
    try:
        one, two = make(), make()
        found, _ = read(one), read(two)
    except (ValueError, TypeError, AttributeError, NotImplementedError, RuntimeError):
        # Not for this object.
        return []
    written = []
    for path, array in arrays(found):
        base = array.base
        if not array.flags.writeable and isinstance(base, np.ndarray) and base.flags.writeable:
            return [f"{path}: the array behind the view is writable"]
        if array.flags.writeable and array.size:
            with np.errstate(all="ignore"):
                spoil(array)
            written.append(path)
    if not written:
        return []
    try:
        again, expected = numbers(read(one)), numbers(read(two))
    except (ValueError, bb.DivergedError):
        # Twice is too often.
        again = expected = []
    if not same(again, expected):
        return [f"{path}: writing it changes the next reading" for path in written]
    try:
        after, expected = future(one), future(two)
    except ValueError:
        return []
    return [] if same(after, expected) else [f"{path}: writing it changes the simulation" for path in written]


@pytest.mark.slow("all attributes of all classes")
@pytest.mark.parametrize("name", sorted(everything()))
def test_arrays_are_read_only_or_copies(name):
    if name == "BallbotVecEnv":
        pytest.importorskip("stable_baselines3")
    found = []
    for make in everything()[name]:
        for full, read in readers(make, name):
            found += [f"{full}{leak}" for leak in leaks(make, read)]
    assert not found, "\n".join(found)


def test_functions_give_new_arrays():
    for target in surface.targets():
        if target.instances or inspect.isclass(target.function):
            continue

        def call(_, target=target):
            return target.function(**{name: target.right(name)[0] for name, needed in target.arguments if needed})

        assert not leaks(lambda: None, call), target.name


def test_every_class_is_looked_at():
    classes = {name for name in bb.__all__ if inspect.isclass(getattr(bb, name, None))}
    assert classes == {*everything(), *WITHOUT} & classes
    assert not {*everything()} & WITHOUT


def test_a_leak_would_be_found():
    class Leaky:
        def __init__(self):
            self.numbers = np.zeros(3)
            self.view = self.numbers.view()
            self.view.flags.writeable = False

    assert leaks(Leaky, lambda one: one.numbers) == [": writing it changes the next reading"]
    assert leaks(Leaky, lambda one: {"a": (one.numbers,)}) == ["['a'][0]: writing it changes the next reading"]
    assert leaks(Leaky, lambda one: one.view) == [": the array behind the view is writable"]
    assert not leaks(Leaky, lambda one: one.numbers.copy())
