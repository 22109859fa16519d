"""The environments made by the functions that `make_vec_env` passes to a vector environment class."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from stable_baselines3.common.monitor import Monitor

from ballbot_rs.envs.gymnasium_env import BallbotEnv

Functions = Sequence[Callable[[], gymnasium.Env[Any, Any]]]


class Made:
    """The common task and options of environments, and the `Monitor` around each, from the functions that make them.

    Raises:
        TypeError: a function does not return an environment of this package.
        ValueError: there is no function, the environments differ, or a wrapper does not exist for a batch.
    """

    def __init__(self, functions: Functions) -> None:
        if not functions:
            raise ValueError("BallbotVecEnv got no functions: it needs at least 1")
        envs = [_Made(function()) for function in functions]
        for i, env in enumerate(envs):
            if env.alike() != envs[0].alike():
                raise ValueError(
                    f"the environments of functions 0 and {i} differ: "
                    f"{_difference(envs[0].alike(), env.alike())}; a BallbotVecEnv has one set of options"
                )
        first = envs[0]
        self.num_envs = len(envs)
        self.task: str = first.env.task
        self.options = first.options()
        self.render_mode = first.env.render_mode
        # The renderer takes the terrain and the threads from the batch.
        self.render_options = {
            name: value
            for name, value in first.env._render_arguments[1].items()
            if name not in ("num_threads", "terrain")
        }
        self.monitor = Episodes([env.monitor for env in envs])


class _Made:
    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self.monitor: Monitor | None = None
        self._limit: int | None = None
        while isinstance(env, gymnasium.Wrapper):
            if isinstance(env, Monitor):
                self.monitor = env
            elif isinstance(env, TimeLimit):
                self._limit = env._max_episode_steps
            elif not isinstance(env, (OrderEnforcing, PassiveEnvChecker)):
                raise ValueError(
                    f"BallbotVecEnv steps its robots at once, without the wrapper {type(env).__name__} of a function: "
                    "wrap the BallbotVecEnv in a VecEnvWrapper"
                )
            env = env.env
        if not isinstance(env, BallbotEnv):
            raise TypeError(f"BallbotVecEnv got a function that makes a {type(env).__name__}, expected a BallbotEnv")
        self.env = env

    def options(self) -> dict[str, Any]:
        """The given options, and the limit that Gymnasium enforces."""
        limit = {} if self._limit is None else {"max_episode_steps": self._limit}
        return {**self.env._batch_arguments[-1], **limit}

    def alike(self) -> dict[str, Any]:
        """Properties that must be equal in all environments of a batch."""
        return {
            "task": self.env.task,
            **self.env.task_options,
            "max_episode_steps": self.options().get("max_episode_steps"),
            "render_mode": self.env.render_mode,
            "Monitor": self.monitor is not None,
        }


def _difference(one: dict[str, Any], other: dict[str, Any]) -> str:
    names = [name for name in {**one, **other} if one.get(name) != other.get(name)]
    return ", ".join(f"{name} = {one.get(name)!r} and {other.get(name)!r}" for name in names)


class Episodes:
    """Returns and lengths of episodes as the `Monitor` of each environment counts them, in its file if it has one."""

    def __init__(self, monitors: Sequence[Monitor | None]) -> None:
        found = [monitor for monitor in monitors if monitor is not None]
        #: Whether there are monitors.
        self.is_used = bool(found)
        self._start = found[0].t_start if found else 0.0
        self._keywords = found[0].info_keywords if found else ()
        if found and found[0].reset_keywords:
            raise ValueError(f"reset_keywords = {found[0].reset_keywords!r} of Monitor: resets of robots take none")
        self._rejects_early = any(not monitor.allow_early_resets for monitor in found)
        self._is_reset = False
        self._writers = [monitor.results_writer for monitor in found]
        self._returns: npt.NDArray[np.float64] = np.zeros(len(found))
        self._lengths: npt.NDArray[np.int64] = np.zeros(len(found), dtype=np.int64)

    def reset(self) -> None:
        """Forgets the episodes that have begun.

        Raises:
            RuntimeError: an episode has begun, and a `Monitor` has `allow_early_resets=False`.
        """
        if self._rejects_early and self._is_reset:
            raise RuntimeError(
                "reset of robots within their episodes, which allow_early_resets=False of Monitor forbids"
            )
        self._is_reset = True
        self._returns[:] = 0.0
        self._lengths[:] = 0

    def step(self, rewards: npt.NDArray[np.float64], dones: npt.NDArray[np.bool_], infos: list[dict[str, Any]]) -> None:
        """Counts a step; the infos of episodes that end get `episode`."""
        self._returns += rewards
        self._lengths += 1
        for i in np.flatnonzero(dones):
            episode = {
                "r": round(float(self._returns[i]), 6),
                "l": int(self._lengths[i]),
                "t": round(time.time() - self._start, 6),
                **{name: infos[i][name] for name in self._keywords},
            }
            if (writer := self._writers[i]) is not None:
                writer.write_row(episode)
            infos[i]["episode"] = episode
        self._returns[dones] = 0.0
        self._lengths[dones] = 0

    def close(self) -> None:
        """Closes the files."""
        for writer in self._writers:
            if writer is not None:
                writer.close()

    def __getstate__(self) -> dict[str, Any]:
        # A copy does not write into the files of the original.
        return {**self.__dict__, "_writers": [None] * len(self._writers)}
