"""The balance task as a Gymnasium environment on one robot of MuJoCo or PyBullet, for SB3's vector environments."""

from typing import Any

import gymnasium
import numpy as np

from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.envs.spaces import action_space, observation_space
from validation.benchmarks import task
from validation.engines.any_robot import make_external_robot
from validation.engines.steps import SUBSTEPS


class ExternalEnv(gymnasium.Env[task.Floats, task.Floats]):
    """The balance task on one robot of `engine`."""

    def __init__(self, engine: str, seed: int = 0) -> None:
        self.observation_space = observation_space("balance")
        self.action_space = action_space()
        self._robot = robot_geometry()
        self._external = make_external_robot(engine, self._robot)
        self._rng = np.random.default_rng(seed)
        self._last_action = np.zeros((1, 3), dtype=np.float32)
        self._position = np.array([0.0, 0.0, self._robot.params.ball_radius])
        self._steps = 0

    def _sensed(self) -> task.Sensed:
        return task.Sensed(*(part[np.newaxis] for part in self._external.sense()))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[task.Floats, dict[str, Any]]:
        """Begins an episode."""
        super().reset(seed=seed, options=options)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        start = task.draw_starts(self._robot, self._rng, 1)
        self._external.reset_raw(
            start.attitude[0], start.rate[0], start.wheel_speeds[0], self._position, start.ball_velocity[0],
            start.ball_rate[0],
        )  # fmt: skip
        self._steps, self._last_action = 0, np.zeros((1, 3), dtype=np.float32)
        return task.observe(self._sensed(), self._last_action)[0], {}

    def step(self, action: task.Floats) -> tuple[task.Floats, float, bool, bool, dict[str, Any]]:
        """Applies an action for one control step."""
        clipped = np.clip(action, -1.0, 1.0)[np.newaxis]
        self._external.step(clipped[0] * task.MAX_TORQUE, SUBSTEPS)
        self._steps += 1
        sensed = self._sensed()
        rewards, fallen = task.reward_and_fall(sensed, clipped, self._last_action)
        self._last_action = clipped
        truncated = self._steps >= task.MAX_EPISODE_STEPS
        return task.observe(sensed, clipped)[0], float(rewards[0]), bool(fallen[0]), truncated, {}

    def close(self) -> None:
        """Frees the engine."""
        self._external.close()
