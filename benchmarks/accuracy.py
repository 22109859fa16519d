"""Whether each engine's robot is a working ballbot: loads, growth of a small tilt, direction of the wheels' drive."""

from collections.abc import Callable
from typing import Any

import numpy as np

import ballbot_rs as bb
from benchmarks import simulators, task
from benchmarks.gym_env import AnyRobot, make_peer
from benchmarks.ours import known_models, make_env
from benchmarks.robot import SIM_DT, SUBSTEPS, Array, Robot, make_robot
from benchmarks.rotations import matrix
from benchmarks.worker import in_child

#: Unstable pole of the paper's robot, 1/s.
EXACT_GROWTH = 6.09174451

#: A tilt that stays small, rad, and when it is read, s.
_TILT, _READ_AT = 1e-3, (0.3, 0.6)
#: Torque on one wheel, N·m, far below slip, and for how many steps.
_TORQUE, _PUSHED = 0.1, 10
#: Where an engine's robots are stepped together.
_VEC_ENVS = {"mujoco": "mujoco-batch", "pybullet": "pybullet-dummy"}
#: Torque on each wheel, N·m, the task's largest: twice what slips.
_SLIPPING = task.MAX_TORQUE


class OurRobot:
    """A `ballbot_rs.Ballbot` as the peers' robots are asked."""

    def __init__(self, model: str) -> None:
        self._robot = bb.Ballbot(model=model, sim_dt=SIM_DT)

    def reset(self, state: bb.State) -> None:
        """Starts anew from `state`."""
        self._robot.reset(state)

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""
        self._robot.step(torques, steps=steps)

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Attitude (4), body rate (3), wheel speeds (3), ball position and velocity (2 each)."""
        s = self._robot.state
        rates = (s.body_angular_velocity, s.wheel_speeds)
        return s.body_quaternion, *rates, s.ball_position[:2], s.ball_velocity[:2]

    def wheel_loads(self) -> Array:
        """Normal forces (3, N)."""
        return self._robot.contacts.wheel_normal_forces

    def close(self) -> None:
        """Nothing to close."""


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of engine and its errors, or the reason of absence."""
    rows: list[dict[str, Any]] = []
    for engine in [*(f"ours:{model}" for model in known_models()), "mujoco", "pybullet"]:
        print(f"accuracy: {engine}", flush=True)
        reason = None if engine.startswith("ours:") else simulators.missing(engine)
        try:
            row = (
                {"reason": reason}
                if reason
                else in_child("accuracy:measure_here", pinned=True, engine=engine, quick=quick)
            )
        except Exception as error:
            row = {"reason": str(error)}
        rows.append({"engine": engine} | row)
    rows.append({"engine": "task in NumPy"} | in_child("accuracy:task_error", pinned=True))
    return rows


def measure_here(engine: str, quick: bool) -> dict[str, Any]:
    """Everything about one engine; "yaw 0" is where the throughput is measured, the rest is over all headings."""
    robot: AnyRobot = OurRobot(engine.removeprefix("ours:")) if engine.startswith("ours:") else make_peer(engine)
    model = make_robot()
    params = model.params
    count = 8 if quick else 16
    yaws = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    growth = {float(yaw): [_growth(robot, params, yaw, azimuth) for azimuth in yaws[::2]] for yaw in yaws}
    drive = {float(yaw): [_drive(robot, params, yaw, wheel) for wheel in range(3)] for yaw in yaws}
    slip = [_slip_limit(robot, model, yaw) for yaw in yaws]
    loads = _loads(robot, params)
    robot.close()
    weight = params.body_mass * params.gravity / (3.0 * np.cos(params.wheel_zenith))
    return {
        "falls_per_second": _falls(engine),
        "wheel_load": loads.tolist(),
        "exact_wheel_load": weight,
        "growth_yaw_0": _extremes(growth[0.0]),
        "growth_all_yaws": _extremes([value for values in growth.values() for value in values]),
        "exact_growth": EXACT_GROWTH,
        "drive_direction_error_yaw_0_deg": max(angle for angle, _ in drive[0.0]),
        "drive_direction_error_all_yaws_deg": max(angle for values in drive.values() for angle, _ in values),
        "slip_limit_yaw_0": slip[0],
        "slip_limit_all_yaws": _extremes(slip),
        "drive_strength_yaw_0": _extremes([strength for _, strength in drive[0.0]]),
        "drive_strength_all_yaws": _extremes([strength for values in drive.values() for _, strength in values]),
    }


def _extremes(values: list[float]) -> list[float]:
    """Smallest, median and largest."""
    return [float(np.min(values)), float(np.median(values)), float(np.max(values))]


def _advance(robot: AnyRobot, torques: Array, steps: int) -> None:
    for _ in range(steps // SUBSTEPS):
        robot.step(torques, SUBSTEPS)


def _tilt(robot: AnyRobot) -> float:
    mast = matrix(np.asarray(robot.sense()[0]))[:, 2]
    return float(np.hypot(mast[0], mast[1]))


def _growth(robot: AnyRobot, params: bb.Params, yaw: float, azimuth: float) -> float:
    """Growth rate of a tilt from rest, which follows cosh, 1/s."""
    robot.reset(bb.State.upright(params, _TILT * np.array([np.cos(azimuth), np.sin(azimuth)]), yaw))
    (a, b), tilts = _READ_AT, []
    for duration in (a, b - a):
        _advance(robot, np.zeros(3), round(duration / SIM_DT))
        tilts.append(_tilt(robot))
    return _root(lambda rate: np.cosh(rate * b) / np.cosh(rate * a) - tilts[1] / tilts[0], 0.0, 60.0)


def _root(rising: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function crosses zero, by bisection; an end if it does not."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rising(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def _drive(robot: AnyRobot, params: bb.Params, yaw: float, wheel: int) -> tuple[float, float]:
    """How a ball starts to move when one wheel is driven: angle to the exact motion (deg) and share of its speed."""
    start, exact = bb.State.upright(params, yaw=yaw), OurRobot("spatial")
    torques = np.zeros(3)
    torques[wheel] = _TORQUE
    velocities = []
    pair: tuple[AnyRobot, AnyRobot] = (robot, exact)
    for one in pair:
        one.reset(start)
        # Contacts of the rigid engines take their load first.
        _advance(one, np.zeros(3), _PUSHED)
        _advance(one, torques, _PUSHED)
        velocities.append(np.array(one.sense()[4]))
    found, expected = velocities
    cross, dot = found[0] * expected[1] - found[1] * expected[0], found @ expected
    return float(np.degrees(abs(np.arctan2(cross, dot)))), float(np.hypot(*found) / np.hypot(*expected))


def _slip_limit(robot: AnyRobot, model: Robot, yaw: float) -> float:
    """Mean traction of slipping wheels over load times friction coefficient: 1 is Coulomb's."""
    p = model.params
    robot.reset(bb.State.upright(p, yaw=yaw))
    _advance(robot, np.zeros(3), _PUSHED)
    torques, spins = np.full(3, _SLIPPING), []
    for _ in range(2):
        _advance(robot, torques, SUBSTEPS)
        _, rate, speeds, _, _ = robot.sense()
        spins.append(np.asarray(speeds) + model.axles @ np.asarray(rate))
    spun_up = p.wheel_inertia * (spins[1] - spins[0]) / (SUBSTEPS * SIM_DT)
    load = p.body_mass * p.gravity / (3.0 * np.cos(p.wheel_zenith))
    return float(np.mean(torques - spun_up) / (p.wheel_radius * p.wheel_dynamic_friction * load))


def _loads(robot: AnyRobot, params: bb.Params) -> Array:
    """Loads of the wheels (3, N) of the robot upright at rest, after 0.3 s."""
    robot.reset(bb.State.upright(params))
    for _ in range(round(0.3 / SIM_DT)):
        robot.step(np.zeros(3), 1)
    return np.asarray(robot.wheel_loads())


def _falls(engine: str) -> float:
    """Ends of episodes a robot and second under the actions of the throughput, over 2 s of 64 robots."""
    env = simulators.vec_env(_VEC_ENVS.get(engine, engine), 64, 1)
    try:
        env.reset()
        ended = [env.step(action)[2].sum() for action in task.make_actions(200, 64)]
    finally:
        env.close()
    return float(np.sum(ended)) / (64 * 200 * SUBSTEPS * SIM_DT)


def task_error() -> dict[str, Any]:
    """Largest difference of the peers' observations and rewards from this simulator's, along the same episodes."""
    env = make_env("spatial", 64, 1, reset_yaw=np.pi)
    env.reset()
    last = np.zeros((64, 3), dtype=np.float32)
    errors = {"observation": 0.0, "reward": 0.0, "falls": 0, "falls_disagreeing": 0}
    for action in task.make_actions(60, 64):
        observations, rewards, dones, _ = env.step(action)
        state = env.states
        sensed = task.Sensed(state[:, 16:20], state[:, 23:26], state[:, 29:32], state[:, :2], state[:, 7:9])
        expected, fallen = task.reward_and_fall(sensed, action, last)
        on = ~dones
        errors["falls"] += int(dones.sum())
        errors["falls_disagreeing"] += int(fallen[on].sum())
        difference = np.abs(task.observe(sensed, action) - np.asarray(observations))[on]
        errors["observation"] = max(errors["observation"], float(difference.max()))
        errors["reward"] = max(errors["reward"], float(np.abs(expected - rewards)[on].max()))
        last = np.where(dones[:, np.newaxis], np.float32(0.0), action)
    return {"task": errors}
