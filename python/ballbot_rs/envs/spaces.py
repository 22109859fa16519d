"""Spaces of one environment."""

from typing import cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from ballbot_rs._core import SCALED_BOUND, TASKS, Batch
from ballbot_rs.envs.own.batch import OwnBatch
from ballbot_rs.envs.registration import description_of

FloatArray = npt.NDArray[np.float32]


def observation_space(task: str, scaled: bool = True, history: int = 1) -> spaces.Space[FloatArray]:
    """Space of one observation of a task: float32, finite bounds; `scaled` as the option `scale_observations`."""
    # Tasks in Python scale by themselves.
    scaled = scaled and task in TASKS
    bounds = [SCALED_BOUND if scaled else row["bound"] for row in description_of(task)["observation"]]
    high = np.array(bounds * history, dtype=np.float32)
    return cast("spaces.Space[FloatArray]", spaces.Box(-high, high, dtype=np.float32))


def observation_space_of(batch: Batch) -> spaces.Space[FloatArray]:
    """Space of one observation of a batch."""
    if isinstance(batch, OwnBatch):
        return cast("spaces.Space[FloatArray]", spaces.Box(-batch.bound, batch.bound, dtype=np.float32))
    return observation_space(batch.task, batch.scale_observations, batch.history)


def action_space() -> spaces.Space[FloatArray]:
    """Space of one action: three float32 in [-1, 1]."""
    return cast("spaces.Space[FloatArray]", spaces.Box(-1.0, 1.0, (3,), dtype=np.float32))
