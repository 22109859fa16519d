"""What every front end shares: a batch of environments, its spaces, and how it is copied and pickled."""

import operator
import secrets
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from ballbot_rs._core import OBSERVATION, Batch

FloatArray = npt.NDArray[np.float32]


def observation_space() -> spaces.Space[FloatArray]:
    """Space of one observation: 16 float32, finite bounds, rows as documented by `BalanceEnv`."""
    high = np.array([bound for _, _, bound in OBSERVATION], dtype=np.float32)
    return cast("spaces.Space[FloatArray]", spaces.Box(-high, high, dtype=np.float32))


def action_space() -> spaces.Space[FloatArray]:
    """Space of one action: three float32 in [-1, 1]."""
    return cast("spaces.Space[FloatArray]", spaces.Box(-1.0, 1.0, (3,), dtype=np.float32))


#: Options of the task, fixed once an environment is made.
OPTIONS = (
    *("params", "model", "sim_dt", "control_dt", "max_episode_steps", "max_wheel_torque", "setpoint", "reward"),
    *("reset_tilt", "reset_yaw", "reset_ball_speed", "reset_tilt_rate"),
    *("fall_tilt", "success_window", "success_tilt", "success_radius"),
)


def refuse_option(name: str) -> None:
    """Raises AttributeError for an option of the task: setting it as an attribute would change nothing."""
    if name in OPTIONS:
        raise AttributeError(f"{name} is fixed once an environment is made: make one with {name}=...")


class BatchOwner:
    """Owns a `Batch` and carries it through `copy.deepcopy` and `pickle` with everything the future depends on."""

    _batch: Batch

    def _make_batch(
        self,
        num_envs: int,
        autoreset: str,
        num_threads: int | None,
        seed: int | None,
        options: Mapping[str, Any],
    ) -> None:
        check_count("num_envs", num_envs)
        check_count("max_episode_steps", options["max_episode_steps"])
        if num_threads is not None:
            check_count("num_threads", num_threads)
        self._batch_arguments = (num_envs, autoreset, num_threads, dict(options))
        seed = secrets.randbits(63) if seed is None else check_seed(seed)
        self._batch = Batch(num_envs, autoreset, num_threads, seed, **options)

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        batch = state.pop("_batch")
        state.pop("_renderer", None)
        state["_snapshots"] = [batch.snapshot(i) for i in range(batch.num_envs)]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshots = state.pop("_snapshots")
        self.__dict__.update(state)
        num_envs, autoreset, num_threads, options = self._batch_arguments
        self._batch = Batch(num_envs, autoreset, num_threads, 0, **options)
        for i, snapshot in enumerate(snapshots):
            self._batch.restore(i, snapshot)


def check_count(name: str, value: int) -> None:
    """Raises TypeError or ValueError, naming the value, unless it is a whole number of at least 1."""
    if _whole(name, value) < 1:
        raise ValueError(f"{name} = {value}, it must be at least 1")


def _whole(name: str, value: int) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name} = {value!r} is not a whole number") from None


def check_seed(seed: int) -> int:
    """The seed as an int; TypeError or ValueError, naming it, unless it is a whole number in [0, 2**64)."""
    seed = _whole("seed", seed)
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed = {seed} is out of range: it must be from 0 to 2**64 - 1")
    return seed


def check_options(options: Mapping[str, Any] | None, known: tuple[str, ...]) -> dict[str, Any]:
    """Reset options as a dict; a ValueError names one that is not known."""
    options = dict(options or {})
    for name in options:
        if name not in known:
            raise ValueError(f"unknown reset option '{name}': expected one of {', '.join(known)}")
    return options
