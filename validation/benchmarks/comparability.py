"""Whether the simulators of the benchmark have the same robot and the same task."""

from typing import Any

import numpy as np

from validation.against_engines.accuracy import accuracy
from validation.benchmarks import simulators, task
from validation.benchmarks.ours import known_models, make_env
from validation.benchmarks.worker import in_child
from validation.engines.any_robot import AnyRobot, make_external_robot
from validation.engines.installed import missing
from validation.engines.our_robot import OurRobot
from validation.engines.steps import SIM_DT, SUBSTEPS

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
                else in_child("comparability:measure_here", pinned=True, engine=engine, quick=quick)
            )
        except Exception as error:
            row = {"reason": str(error)}
        rows.append({"engine": engine} | row)
    rows.append({"engine": "task in NumPy"} | in_child("comparability:task_error", pinned=True))
    return rows


def measure_here(engine: str, quick: bool) -> dict[str, Any]:
    """All results of one engine; the throughput is measured at "yaw 0", the rest is over all headings."""
    robot: AnyRobot = (
        OurRobot(engine.removeprefix("ours:")) if engine.startswith("ours:") else make_external_robot(engine)
    )
    try:
        found = accuracy(robot, 8 if quick else 16)
    finally:
        robot.close()
    return {"falls_per_second": _falls(engine)} | found


def _falls(engine: str) -> float:
    """Ends of episodes per robot and second under the actions of the throughput, over 2 s of 64 robots."""
    env = simulators.vec_env(_VEC_ENVS.get(engine, engine), 64, 1)
    try:
        env.reset()
        ended = [env.step(action)[2].sum() for action in task.make_actions(200, 64)]
    finally:
        env.close()
    return float(np.sum(ended)) / (64 * 200 * SUBSTEPS * SIM_DT)


def task_error() -> dict[str, Any]:
    """Largest difference of the NumPy task's observations and rewards from this simulator's, over the same episodes."""
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
