"""Spaces of one environment."""

from typing import cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from ballbot_rs._core import OBSERVATION

FloatArray = npt.NDArray[np.float32]


def observation_space() -> spaces.Space[FloatArray]:
    """Space of one observation: float32, finite bounds, rows as documented by `BalanceEnv`."""
    high = np.array([bound for _, _, bound in OBSERVATION], dtype=np.float32)
    return cast("spaces.Space[FloatArray]", spaces.Box(-high, high, dtype=np.float32))


def action_space() -> spaces.Space[FloatArray]:
    """Space of one action: three float32 in [-1, 1]."""
    return cast("spaces.Space[FloatArray]", spaces.Box(-1.0, 1.0, (3,), dtype=np.float32))
