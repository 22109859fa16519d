"""Every optional argument of every public method changes something; test_keywords.py has functions and constructors.

`ELSEWHERE` lists classes that need files, pages or other libraries, with the tests that call their methods.
"""

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.keywords import PAPER, START, With, changes

OTHER = bb.State.at_rest(PAPER, tilt=(-0.05, 0.02))
#: Above the floor also for a larger ball.
HIGH = bb.State.at_rest(PAPER.replace(ball_radius=0.118), tilt=(0.06, -0.03))
TORQUES = np.array([[0.1, 0.02, 0.0], [0.05, 0.0, 0.1]])
LOADED = PAPER.with_payload(0.3, position=(0.0, 0.0, 0.3), stiffness=90.0)
LOADED = LOADED.with_payload(0.1, position=(0.1, 0.0, 0.2), stiffness=20.0, payload=1)
PUSH = (0.1, 0.2, 0.0)
FORCE = (2.0, 3.0, 0.0)
WAVE = {"frequency": 30.0, "phase": With(0.4, frequency=30.0), "delay": 0.002, "duration": 0.002}
LQR = bb.Lqr(control_dt=0.01)
POLICIES = [(np.full((2, 3, 16), 0.1), np.full((2, 3), 0.1))]


def _robot(**options: Any) -> bb.Ballbot:
    robot = bb.Ballbot(PAPER, "contact", **options)
    robot.reset(START)
    return robot


def _moved(robot: bb.Ballbot) -> bb.State:
    robot.step((0.1, 0.0, 0.05), 3)
    return robot.state


def _then(robot: bb.Ballbot, method: str, **given: Any) -> bb.State:
    getattr(robot, method)(**given)
    return _moved(robot)


def _crowd() -> bb.Crowd:
    return bb.Crowd([PAPER, "kugle"], [(0.0, 0.0), (1.0, 0.0)])


def _then_all(crowd: bb.Crowd, method: str, **given: Any) -> list[bb.State]:
    getattr(crowd, method)(**given)
    crowd.step(np.full((len(crowd), 3), 0.1), 3)
    return crowd.states


def _of_crowd(method: str, **given: Any) -> list[bb.State]:
    return _then_all(_crowd(), method, **given)


def _batch(**options: Any) -> bb.Batch:
    """Two robots that differ."""
    events = [
        *bb.load_events("hard"),
        {"term": "sensors.gyro_noise", "op": "abs", "range": [0.01, 0.02]},
        {"term": "push", "id": 7, "every": [0.01, 0.2], "range": [0.01, 0.02]},
    ]
    defaults = {"model": "contact", "sensors": "kugle", "observation": "sensors", "events": events, "seed": 0}
    batch = bb.Batch(2, "velocity", num_threads=1, **{**defaults, **options})
    batch.reset()
    for _ in range(12):
        batch.step(TORQUES)
    return batch


def _stepped(env: Any, method: str, **given: Any) -> Any:
    getattr(env, method)(**given)
    n = getattr(env, "num_envs", None)
    return env.step(np.full((3,) if n is None else (n, 3), 0.2, np.float32))


def _env() -> Any:
    env = bb.BalanceEnv(model="contact")
    env.reset(seed=1)
    return env


def _envs() -> Any:
    envs = bb.BalanceVectorEnv(2, model="contact", num_threads=1)
    envs.reset(seed=1)
    envs.step(np.full((2, 3), 0.2, np.float32))
    return envs


def _of_one(name: str) -> Callable[..., Any]:
    return lambda **given: getattr(_batch(), name)(**given)


def _jacobians() -> bb.MotionJacobians:
    return _robot().jacobians(TORQUES, 2, ["body_mass"])


def _estimated(**given: Any) -> bb.State:
    estimator = bb.Estimator()
    estimator.reset(**given)
    return estimator.update({"gyro": (0.1, 0.2, 0.0), "specific_force": (0.3, 0.0, 9.8), "wheel_angles": (0.0,) * 3})


def _frame(**given: Any) -> Any:
    renderer = bb.Renderer(width=80, height=60, num_threads=1)
    return renderer.render(START, **given)


def _contacts() -> bb.Contacts:
    robot = _robot()
    robot.step((0.1, 0.0, 0.05))
    return robot.contacts


#: Methods: how each is called, its other arguments, and another value than the default of each optional argument.
METHODS: dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, Any]]] = {
    "Ballbot.reset": (lambda **given: _then(_robot(), "reset", **given), {}, {"state": OTHER}),
    "Ballbot.step": (
        lambda **given: _then(_robot(), "step", **given),
        {"wheel_torques": (0.1, 0.0, 0.0)},
        {"steps": 3},
    ),
    "Ballbot.push": (lambda **given: _then(_robot(), "push", **given), {"impulse": PUSH}, {"point": (0.0, 0.1, 0.2)}),
    "Ballbot.move_payload": (
        lambda **given: _then(bb.Ballbot(LOADED), "move_payload", **given),
        {"offset": (0.01, 0.0, 0.0)},
        {"payload": 1},
    ),
    "Ballbot.apply_force": (
        lambda **given: _then(_robot(), "apply_force", **given),
        {"force": FORCE},
        {"point": (0.0, 0.1, 0.2), **WAVE},
    ),
    "Crowd.reset": (
        lambda **given: _of_crowd("reset", **given),
        {},
        {"states": [bb.State.at_rest(PAPER, tilt=(0.1, 0.0)), _crowd().states[1]]},
    ),
    "Crowd.step": (
        lambda **given: _of_crowd("step", **given),
        {"wheel_torques": ((0.1, 0.0, 0.0), (0.0, 0.0, 0.0))},
        {"steps": 3},
    ),
    "Crowd.push": (
        lambda **given: _of_crowd("push", **given),
        {"robot": 1, "impulse": PUSH},
        {"point": (0.0, 0.1, 0.2)},
    ),
    "Crowd.move_payload": (
        lambda **given: _then_all(bb.Crowd([LOADED], [(0.0, 0.0)]), "move_payload", **given),
        {"robot": 0, "offset": (0.01, 0.0, 0.0)},
        {"payload": 1},
    ),
    "Crowd.apply_force": (
        lambda **given: _of_crowd("apply_force", **given),
        {"robot": 0, "force": FORCE},
        {"point": (0.0, 0.1, 0.2), **WAVE},
    ),
    "Ballbot.place_on_ground": (
        lambda **given: _then(bb.Ballbot(terrain=bb.Terrain.plane(0.1)), "place_on_ground", **given),
        {"x": 0.1, "y": 0.0},
        {"yaw": 0.3, "tilt": (0.05, 0.0)},
    ),
    "Ballbot.jacobian": (
        lambda **given: [getattr(_robot().jacobian(**given), part) for part in ("A", "B", "P")],
        {"wheel_torques": (0.1, 0.0, 0.0)},
        {"steps": 2, "parameters": ["body_mass"]},
    ),
    "Ballbot.jacobians": (
        lambda **given: [getattr(_robot().jacobians(**given), part) for part in ("A", "B", "P")],
        {"wheel_torques": TORQUES},
        {"steps": 2, "parameters": ["body_mass"]},
    ),
    "MotionJacobians.jvp": (
        lambda **given: _jacobians().jvp(**given),
        {},
        {"state": np.ones(_jacobians().A.shape[-1]), "torques": np.ones((2, 3)), "parameters": [1.0]},
    ),
    "Lqr.deviation": (
        lambda **given: bb.Lqr().deviation(START, **given),
        {},
        {"position": (0.1, 0.0), "velocity": (0.1, 0.0), "yaw": 0.1},
    ),
    "OnnxPolicy.initial_state": (
        lambda **given: bb.OnnxPolicy("assets/policies/balance.onnx").initial_state(**given),
        {},
        {"count": 3},
    ),
    "OnnxPolicy.controller": (
        lambda **given: bb.OnnxPolicy("assets/policies/balance-any.onnx").controller(**given)(START),
        {},
        {"robot": "kugle"},
    ),
    "StateFeedback.__call__": (
        lambda **given: bb.StateFeedback(np.arange(30.0).reshape(3, 10))(START, **given),
        {},
        {"position": (0.1, 0.0), "velocity": (0.1, 0.0), "yaw": 0.1, "yaw_rate": 0.1},
    ),
    "Estimator.reset": (_estimated, {}, {"state": START}),
    "Params.holding_torques": (PAPER.replace(floor_tilt=(0.05, 0.0)).holding_torques, {}, {"yaw": 0.3}),
    "Params.with_payload": (
        LOADED.with_payload,
        {"mass": 0.5},
        {
            "position": (0.0, 0.01, 0.3),
            "stiffness": 200.0,
            "damping": (1.0, 2.0, 3.0),
            "inertia": 0.001,
            "payload": 1,
        },
    ),
    "Params.slope_limits": (PAPER.slope_limits, {}, {"fall_tilt": 0.2}),
    "Reference.slowdown": (bb.Reference.circle(0.5, 4.0, robot=PAPER).slowdown, {}, {"friction": 0.2}),
    "Renderer.render": (_frame, {}, {"contacts": _contacts(), "arrows": [((0.0, 0.0, 0.5), (0.3, 0.0, 0.0))]}),
    "Rollout.settling_times": (bb.rollout("lqr", 2, tilt=(0.1, 0.0)).settling_times, {}, {"tilt": 0.05}),
    "Terrain.heights": (
        bb.Terrain.generate("wave", size_x=2.0, size_y=2.0, cell=0.1).heights,
        {},
        {"cell": 0.05},
    ),
    "State.at_rest": (bb.State.at_rest, {"robot": PAPER}, {"tilt": (0.1, 0.0), "yaw": 0.2}),
    "State.at_equilibrium": (bb.State.at_equilibrium, {"robot": PAPER}, {"tilt": (0.1, 0.0), "yaw": 0.2}),
    "State.rolling": (
        bb.State.rolling,
        {"robot": PAPER, "ball_velocity": (0.1, 0.0)},
        {
            "body_quaternion": START.body_quaternion,
            "body_angular_velocity": (0.0, 0.1, 0.0),
            "ball_spin": 0.1,
        },
    ),
    "Batch.reset": (
        lambda **given: [(batch := _batch()).reset(**given), batch.states()],
        {},
        {"mask": [True, False], "seeds": [5, 6], "starts": [HIGH, None]},
    ),
    "Batch.push": (
        lambda **given: _stepped(_batch(), "push", index=0, **given),
        {"impulse": PUSH},
        {"point": (0.0, 0.1, 0.2)},
    ),
    "Batch.move_payload": (
        lambda **given: _stepped(_batch(robot=LOADED, events=None), "move_payload", **given),
        {"index": 0, "offset": (0.01, 0.0, 0.0)},
        {"payload": 1},
    ),
    "Batch.apply_force": (
        lambda **given: _stepped(_batch(), "apply_force", index=0, **given),
        {"force": FORCE},
        {"point": (0.0, 0.1, 0.2), **WAVE},
    ),
    "Batch.control": (
        lambda controller="lqr", **given: _batch().control(bb.Controller(controller, control_dt=0.01), **given),
        {},
        {"setpoints": {"velocity": (0.3, 0.1)}, "privileged": True, "drawn": True},
    ),
    "Batch.episodes": (lambda **given: _plain().episodes(**given), {"policies": POLICIES}, {"steps": 2}),
    "Batch.jacobians": (
        lambda **given: [getattr(_plain().jacobians(**given), part) for part in ("A", "B", "P")],
        {"wheel_torques": TORQUES},
        {"steps": 2, "parameters": ["body_mass"]},
    ),
    "Batch.rollout": (
        # One of three is the source of actions.
        lambda steps=3, **given: _plain().rollout(
            given.pop("controller", None if {"policies", "actions"} & {*given} else LQR), steps, **given
        ),
        {},
        {
            "controller": bb.Lqr(control_dt=0.01, max_torque=0.01),
            "steps": 2,
            "setpoints": {"position": (0.3, 0.1)},
            "record": ["torques"],
            "privileged": With(True, record=["actions"]),
            "impulses": np.full((1, 2, 3), 0.1),
            "points": With(np.full((2, 3), 0.1), impulses=np.full((1, 2, 3), 0.1)),
            "start_time": With(1.0, setpoints=bb.Reference.circle(0.3, 6.0)),
            "policies": POLICIES,
            "actions": np.full((3, 2, 3), 0.1),
        },
    ),
    "BallbotEnv.push": (
        lambda **given: _stepped(_env(), "push", **given),
        {"impulse": PUSH},
        {"point": (0.0, 0.1, 0.2)},
    ),
    "BallbotEnv.apply_force": (
        lambda **given: _stepped(_env(), "apply_force", **given),
        {"force": FORCE},
        {"point": (0.0, 0.1, 0.2), **WAVE},
    ),
    "BallbotEnv.reset": (
        lambda **given: _stepped(_env(), "reset", **given),
        {"seed": 1},
        {"seed": 2, "options": {"state": OTHER}},
    ),
    "BallbotVectorEnv.push": (
        lambda **given: _stepped(_envs(), "push", **given),
        {"impulse": PUSH},
        {"point": (0.0, 0.1, 0.2), "index": 1},
    ),
    "BallbotVectorEnv.apply_force": (
        lambda **given: _stepped(_envs(), "apply_force", **given),
        {"force": FORCE},
        {"point": (0.0, 0.1, 0.2), "index": 1, **WAVE},
    ),
    "BallbotVectorEnv.set_params": (
        lambda **given: _stepped(_envs(), "set_params", **given),
        {"params": PAPER.replace(body_mass=3.0)},
        {"index": 1},
    ),
    "BallbotVectorEnv.reset": (
        lambda **given: _stepped(_envs(), "reset", **given),
        {"seed": 1},
        {"seed": 2, "options": {"reset_mask": np.array([True, False])}},
    ),
    **{
        f"Batch.{name}": (_of_one(name), {}, {"index": 1})
        for name in ("actuators", "contacts", "draws", "metrics", "params", "push_count", "readings",
                     "reward_terms", "sensors", "command", "privileged_observations", "setpoint")
    },
    "Batch.nominal_params": (
        # Eight neighbors have the same robot.
        lambda **given: bb.Batch(9, robot=["paper", "kugle"]).nominal_params(**given),
        {},
        {"index": 8},
    ),
    # Few robots are sampled again: tests/rust/core/randomization/combinations.rs has such.
    "Batch.repeated_draws": (_of_one("repeated_draws"), {}, {"index": 2}),
    "Batch.perceived": (
        lambda **given: _batch(scan={"points": (2, 2)}).perceived("scan", **given),
        {},
        {"index": 1},
    ),
    "Batch.on_ground": (
        lambda **given: (batch := _batch(terrain="wave")).on_ground(bb.State.at_rest(batch.params(0)), **given),
        {},
        {"index": 1},
    ),
}  # fmt: skip
#: Methods of classes that other tests call with each argument.
ELSEWHERE = {
    "Page": "tests/viewer/test_show.py",
    "CrowdPage": "tests/viewer/test_show_crowd.py",
    "Replay": "tests/identification/test_replay.py",
    "SensorLog": "tests/identification/test_log.py",
    "Study": "tests/analysis/test_sweep.py",
    "Trajectory": "tests/media/test_plotting.py",
    "Dataset": "tests/analysis/test_dataset.py",
    "DifferentiableBatch": "tests/optimal/test_differentiable.py",
    "DifferentiableJaxBatch": "tests/optimal/test_differentiable_jax.py",
    "BallbotVecEnv": "tests/envs/test_sb3_vec_env.py",
}


FRONT_ENDS = (bb.BallbotEnv, bb.BallbotVectorEnv)


def _plain() -> bb.Batch:
    batch = bb.Batch(2, model="contact", num_threads=1, sensors={"gyro_noise": 0.05}, observation="sensors", seed=3)
    batch.reset()
    return batch


def _optional() -> Iterator[tuple[str, str, str]]:
    """Class, method and argument."""
    for name in bb.__all__:
        owner = getattr(bb, name, None)
        if not inspect.isclass(owner):
            continue
        for method in ("__call__", *(one for one in dir(owner) if not one.startswith("_"))):
            defined = next((base for base in owner.__mro__ if method in vars(base)), None)
            if defined is None or not (defined.__module__ or "").startswith("ballbot_rs"):
                continue
            static = isinstance(inspect.getattr_static(owner, method), staticmethod)
            of_task = issubclass(owner, FRONT_ENDS) and owner not in FRONT_ENDS
            # test_keywords.py has the former, the class of all tasks the latter.
            if not callable(getattr(owner, method)) or (static and name in ("Reference", "Terrain")) or of_task:
                continue
            for parameter in inspect.signature(getattr(owner, method)).parameters.values():
                if parameter.default is not parameter.empty:
                    yield name, method, parameter.name


@pytest.mark.parametrize("name", sorted(METHODS))
def test_arguments_of_methods_change_something(name: str) -> None:
    call, base, arguments = METHODS[name]
    found = [changes(call, argument, [value], base) for argument, value in arguments.items()]
    assert not [wrong for wrong in found if wrong]


def test_every_optional_argument_is_listed() -> None:
    missing: dict[str, list[str]] = {}
    for name, method, argument in _optional():
        if name not in ELSEWHERE and argument not in METHODS.get(f"{name}.{method}", (None, {}, {}))[2]:
            missing.setdefault(f"{name}.{method}", []).append(argument)
    assert not missing
