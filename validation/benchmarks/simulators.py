"""Every simulator by name, and why a simulator is missing."""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from validation.benchmarks import ours, task
from validation.benchmarks.timing import Run, timed
from validation.engines.steps import SIM_DT, SUBSTEPS

#: Time steps in one call of a raw run, and calls before its robots are reset upright: 0.2 s, no robot falls.
RAW_SUBSTEPS, RAW_CALLS = 25, 4


@dataclasses.dataclass
class Running:
    """A constructed simulator: `run` advances it, `close` ends it, `found` has its other results."""

    run: Run
    close: Callable[[], None]
    found: Callable[[], dict[str, Any]] = dict


def environment(
    simulator: str, num_envs: int, num_threads: int, torque: float = task.HEADLINE_TORQUE, settling: int = 0
) -> Running:
    """A `VecEnv` of the balance task under the common actions of ±`torque`; a run is one step of all environments.

    `settling` steps come first; their second half gives the rate of falls.
    """
    env = vec_env(simulator, num_envs, num_threads)
    actions = itertools.cycle(task.make_actions(64, num_envs, torque))
    found = {}
    try:
        env.reset()
        ended = [np.sum(env.step(next(actions))[2]) for _ in range(settling)][settling // 2 :]
        if ended:
            found["falls_per_second"] = float(np.sum(ended)) / (num_envs * len(ended) * SUBSTEPS * SIM_DT)
    except BaseException:
        env.close()
        raise
    return Running(timed(lambda: env.step(next(actions)), num_envs), env.close, lambda: found)


def vec_env(simulator: str, num_envs: int, num_threads: int) -> Any:
    """A `VecEnv`: "ours:<model>", "mujoco-batch", "<engine>-dummy" or "<engine>-subproc"."""
    kind, _, way = simulator.partition("-")
    if simulator.startswith("ours:"):
        return ours.make_env(simulator.removeprefix("ours:"), num_envs, num_threads)
    if simulator == "mujoco-batch":
        from validation.benchmarks.mujoco_batch import MujocoVecEnv

        return MujocoVecEnv(num_envs, num_threads)
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    from validation.benchmarks.gym_env import ExternalEnv

    makers: list[Callable[[], gymnasium.Env[Any, Any]]] = [partial(ExternalEnv, kind, i) for i in range(num_envs)]
    # Other start methods import PyTorch once per environment, which takes minutes.
    return DummyVecEnv(makers) if way == "dummy" else SubprocVecEnv(makers, start_method="fork")


def physics(simulator: str, num_envs: int, num_threads: int) -> Running:
    """Only the engine: a run is `RAW_SUBSTEPS` time steps of all robots, with occasional resets."""
    if simulator == "mujoco-batch":
        return _mujoco_physics(num_envs, num_threads)
    if simulator == "pybullet-dummy":
        return _pybullet_physics(num_envs)
    env = ours.make_env(
        simulator.removeprefix("ours:"), num_envs, num_threads, control_dt=RAW_SUBSTEPS * SIM_DT, sim_dt=SIM_DT
    )
    zeros = np.zeros((num_envs, 3), dtype=np.float32)

    return Running(_restarted(num_envs, lambda: env.step(zeros), env.reset), env.close)


def _restarted(num_envs: int, step: Callable[[], Any], restart: Callable[[], Any]) -> Run:
    calls = itertools.count()

    def before() -> None:
        if next(calls) % RAW_CALLS == 0:
            restart()

    return timed(step, num_envs * RAW_SUBSTEPS, before)


def _mujoco_physics(num_envs: int, num_threads: int) -> Running:
    from validation.benchmarks.mujoco_batch import MujocoBatch

    robots, rng = MujocoBatch(num_envs, num_threads), np.random.default_rng(0)
    everyone: npt.NDArray[np.intp] = np.arange(num_envs)
    step = _restarted(num_envs, lambda: robots.batch.step(nstep=RAW_SUBSTEPS), lambda: robots.start(rng, everyone))
    return Running(step, lambda: None)


def _pybullet_physics(num_envs: int) -> Running:
    from ballbot_rs.engines.robot_geometry import robot_geometry
    from validation.engines.pybullet_robot import PybulletRobot

    robot, rng = robot_geometry(), np.random.default_rng(0)
    robots = [PybulletRobot(robot) for _ in range(num_envs)]
    at, zeros = np.array([0.0, 0.0, robot.params.ball_radius]), np.zeros(3)

    def restart() -> None:
        s = task.draw_starts(robot, rng, num_envs)
        for i, one in enumerate(robots):
            one.reset_raw(s.attitude[i], s.rate[i], s.wheel_speeds[i], at, s.ball_velocity[i], s.ball_rate[i])

    def step() -> None:
        for one in robots:
            one.step(zeros, RAW_SUBSTEPS)

    def close() -> None:
        for one in robots:
            with contextlib.suppress(Exception):
                one.close()

    return Running(_restarted(num_envs, step, restart), close)
