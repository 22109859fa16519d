"""Spaces of one environment."""

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from ballbot_rs._core import SCALED_BOUND, TASKS, Batch, reading_bounds
from ballbot_rs.envs.registration import description_of

FloatArray = npt.NDArray[np.float32]


def observation_space(task: str, options: Mapping[str, Any] | None = None) -> spaces.Space[FloatArray]:
    """Space of one observation of a task: float32, finite bounds; `options` are the options of its environments."""
    options = options or {}
    if task not in TASKS or options.get("rows"):
        from ballbot_rs.envs._batch_env import new_batch

        return observation_space_of(new_batch(1, task=task, num_threads=1, options=options))
    scaled = options.get("scale_observations", True)
    bounds = [SCALED_BOUND if scaled else row["bound"] for row in description_of(task)["observation"]]
    return _space(np.array(bounds, dtype=np.float32), options, scaled)


def observation_space_of(batch: Batch) -> spaces.Space[FloatArray]:
    """Space of one observation of a batch."""
    return _space(batch.observation_bounds, batch.options, batch.scale_observations)


def history_ages(history: Any) -> list[int]:
    """Ages of the observations that the option `history` gives together, newest first, control steps."""
    return [int(age) for age in (history if isinstance(history, Iterable) else range(int(history)))]


def _space(bounds: FloatArray, options: Mapping[str, Any], scaled: bool) -> spaces.Space[FloatArray]:
    state = np.tile(bounds, len(history_ages(options.get("history", 1))))
    least, largest = reading_bounds(options, scaled)
    low, high = np.concatenate((-state, least)), np.concatenate((state, largest))
    return cast("spaces.Space[FloatArray]", spaces.Box(low, high, dtype=np.float32))


def observation_width(task: str, options: Mapping[str, Any]) -> int:
    """Length of an observation."""
    (width,) = observation_space(task, options).shape or (0,)
    return width


def action_space() -> spaces.Space[FloatArray]:
    """Space of one action: three float32 in [-1, 1]."""
    return cast("spaces.Space[FloatArray]", spaces.Box(-1.0, 1.0, (3,), dtype=np.float32))
