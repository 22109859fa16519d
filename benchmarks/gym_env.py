"""The balance task as a Gymnasium environment on one robot of a peer, for SB3's `DummyVecEnv` and `SubprocVecEnv`."""

from typing import Any

import gymnasium
import numpy as np

from ballbot_rs.envs.spaces import action_space, observation_space
from benchmarks import task
from peers.any_robot import make_peer
from peers.robot import SUBSTEPS, make_robot


class PeerEnv(gymnasium.Env[task.Floats, task.Floats]):
    """The balance task on one robot of `engine`."""

    def __init__(self, engine: str, seed: int = 0) -> None:
        self.observation_space = observation_space()
        self.action_space = action_space()
        self._robot = make_robot()
        self._peer = make_peer(engine, self._robot)
        self._rng = np.random.default_rng(seed)
        self._last_action = np.zeros((1, 3), dtype=np.float32)
        self._position = np.array([0.0, 0.0, self._robot.params.ball_radius])
        self._steps = 0

    def _sensed(self) -> task.Sensed:
        return task.Sensed(*(part[np.newaxis] for part in self._peer.sense()))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[task.Floats, dict[str, Any]]:
        """Begins an episode."""
        super().reset(seed=seed, options=options)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        start = task.draw_starts(self._robot, self._rng, 1)
        self._peer.reset_raw(
            start.attitude[0], start.rate[0], start.wheel_speeds[0], self._position, start.ball_velocity[0],
            start.ball_rate[0],
        )  # fmt: skip
        self._steps, self._last_action = 0, np.zeros((1, 3), dtype=np.float32)
        return task.observe(self._sensed(), self._last_action)[0], {}

    def step(self, action: task.Floats) -> tuple[task.Floats, float, bool, bool, dict[str, Any]]:
        """Applies an action for one control step."""
        clipped = np.clip(action, -1.0, 1.0)[np.newaxis]
        self._peer.step(clipped[0] * task.MAX_TORQUE, SUBSTEPS)
        self._steps += 1
        sensed = self._sensed()
        rewards, fallen = task.reward_and_fall(sensed, clipped, self._last_action)
        self._last_action = clipped
        truncated = self._steps >= task.MAX_EPISODE_STEPS
        return task.observe(sensed, clipped)[0], float(rewards[0]), bool(fallen[0]), truncated, {}

    def close(self) -> None:
        """Frees the engine."""
        self._peer.close()
