"""The fastest other simulator: MuJoCo's own threaded batch under a thin Stable-Baselines3 `VecEnv` in NumPy."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from ballbot_rs.engines.mujoco_robot import BALL_VELOCITY, BODY_QUATERNION, BODY_RATE, WHEEL_SPEEDS, mjcf
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.envs.spaces import action_space, observation_space
from validation.benchmarks import task
from validation.engines.fast_mujoco import FAST
from validation.engines.steps import SUBSTEPS


class MujocoBatch:
    """`num_envs` robots in a `mujoco.batch.Batch`: state, start and sensors."""

    def __init__(self, num_envs: int, num_threads: int, persistent: bool = False) -> None:
        from mujoco.batch import Batch

        self.robot = robot_geometry()
        model = mujoco.MjModel.from_xml_string(mjcf(self.robot, FAST))
        self.batch = Batch(model, num_envs, num_threads, persistent)
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._warmstart, self.ctrl = self.batch.bind("qacc_warmstart"), self.batch.bind("ctrl")
        # Views of the state rows: nothing is copied when a step is sensed.
        self.sensed = task.Sensed(
            self._qpos[:, BODY_QUATERNION],
            self._qvel[:, BODY_RATE],
            self._qvel[:, WHEEL_SPEEDS],
            self._qpos[:, :2],
            self._qvel[:, BALL_VELOCITY][:, :2],
        )
        self._rest = np.array(model.qpos0)

    def start(self, rng: np.random.Generator, which: npt.NDArray[np.intp]) -> None:
        """Samples new initial states for the robots `which`."""
        starts = task.draw_starts(self.robot, rng, len(which))
        qpos = np.tile(self._rest, (len(which), 1))
        qpos[:, BODY_QUATERNION] = starts.attitude
        self._qpos[which] = qpos
        velocity = starts.ball_velocity
        self._qvel[which] = np.hstack([velocity, starts.ball_rate, velocity, starts.rate, starts.wheel_speeds])
        self._warmstart[which] = 0.0


class MujocoVecEnv(VecEnv):
    """The balance task on a `MujocoBatch`; finished episodes are reset within the step."""

    def __init__(self, num_envs: int, num_threads: int, seed: int = 0, persistent: bool = False) -> None:
        self.robots = MujocoBatch(num_envs, num_threads, persistent)
        self._rng = np.random.default_rng(seed)
        self._last_action = np.zeros((num_envs, 3), dtype=np.float32)
        self._action = self._last_action
        self._steps = np.zeros(num_envs, dtype=np.int64)
        super().__init__(num_envs, observation_space("balance"), action_space())

    def reset(self) -> task.Floats:
        """Begins episodes in all environments."""
        self.robots.start(self._rng, np.arange(self.num_envs))
        self._last_action = np.zeros((self.num_envs, 3), dtype=np.float32)
        self._steps[:] = 0
        return task.observe(self.robots.sensed, self._last_action)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Takes the actions of the next `step_wait`, (num_envs, 3)."""
        self._action = np.clip(actions, -1.0, 1.0, dtype=np.float32)

    def step_wait(self) -> VecEnvStepReturn:
        """Applies the actions for one control step."""
        robots, action = self.robots, self._action
        np.multiply(action, task.MAX_TORQUE, out=robots.ctrl)
        robots.batch.step(nstep=SUBSTEPS)
        self._steps += 1
        rewards, terminated = task.reward_and_fall(robots.sensed, action, self._last_action)
        observations = task.observe(robots.sensed, action)
        self._last_action = action
        dones = terminated | (self._steps >= task.MAX_EPISODE_STEPS)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            ended = np.flatnonzero(dones)
            for i in ended.tolist():
                truncated = not terminated[i]
                infos[i] = {"terminal_observation": observations[i].copy(), "TimeLimit.truncated": truncated}
            robots.start(self._rng, ended)
            self._steps[ended] = 0
            self._last_action[ended] = 0.0
            observations[ended] = task.observe(_rows(robots.sensed, ended), self._last_action[ended])
        return observations, rewards, dones, infos

    def close(self) -> None:
        """The batch ends with its last reference."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The batch's own attribute for each environment."""
        return [getattr(self, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:  # noqa: ARG002
        """No attribute can be set."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
        """It has no methods for single environments."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:  # noqa: ARG002
        """False: the environments have no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """There is no renderer."""
        return [None] * self.num_envs


def _rows(sensed: task.Sensed, rows: npt.NDArray[np.intp]) -> task.Sensed:
    return task.Sensed(
        sensed.attitude[rows],
        sensed.rate[rows],
        sensed.wheel_speeds[rows],
        sensed.position[rows],
        sensed.velocity[rows],
    )
