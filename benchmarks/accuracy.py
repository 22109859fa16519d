"""Whether each engine's robot is a working ballbot: loads, growth of a small tilt, direction of the wheels' drive."""

from typing import Any

import numpy as np

from benchmarks import simulators, task
from benchmarks.ours import known_models, make_env
from benchmarks.worker import in_child
from peers import probes
from peers.any_robot import AnyRobot, make_peer
from peers.installed import missing
from peers.our_robot import OurRobot
from peers.robot import SIM_DT, SUBSTEPS, make_robot

#: Unstable pole of the paper's robot, 1/s.
EXACT_GROWTH = 6.09174451

#: Where an engine's robots are stepped together.
_VEC_ENVS = {"mujoco": "mujoco-batch", "pybullet": "pybullet-dummy"}


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of engine and its errors, or the reason of absence."""
    rows: list[dict[str, Any]] = []
    for engine in [*(f"ours:{model}" for model in known_models()), "mujoco", "pybullet"]:
        print(f"accuracy: {engine}", flush=True)
        reason = None if engine.startswith("ours:") else missing(engine)
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
    growth = {float(yaw): [probes.growth(robot, params, yaw, azimuth) for azimuth in yaws[::2]] for yaw in yaws}
    drive = {float(yaw): [probes.drive(robot, params, yaw, wheel) for wheel in range(3)] for yaw in yaws}
    slip = [probes.slip_limit(robot, model, yaw) for yaw in yaws]
    loads = probes.wheel_loads(robot, params)
    robot.close()
    return {
        "falls_per_second": _falls(engine),
        "wheel_load": loads.tolist(),
        "exact_wheel_load": probes.resting_load(params),
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
