"""Spaces of one environment."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from ballbot_rs._core import DEPTH_OPTIONS, SCALED_BOUND, SCAN_OPTIONS, TASKS, Batch
from ballbot_rs.envs.registration import description_of

FloatArray = npt.NDArray[np.float32]

#: Largest magnitude of a height of a scan, m.
SCAN_BOUND: Final = 1.0


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


def _space(bounds: FloatArray, options: Mapping[str, Any], scaled: bool) -> spaces.Space[FloatArray]:
    state = np.tile(bounds, options.get("history", 1))
    (scan_low, scan_high), (near, far) = _perceived(options, scaled)
    low = np.concatenate((-state, scan_low, near))
    high = np.concatenate((state, scan_high, far))
    return cast("spaces.Space[FloatArray]", spaces.Box(low, high, dtype=np.float32))


def observation_width(task: str, options: Mapping[str, Any]) -> int:
    """Length of an observation."""
    (width,) = observation_space(task, options).shape or (0,)
    return width


def action_space() -> spaces.Space[FloatArray]:
    """Space of one action: three float32 in [-1, 1]."""
    return cast("spaces.Space[FloatArray]", spaces.Box(-1.0, 1.0, (3,), dtype=np.float32))


def _perceived(options: Mapping[str, Any], scaled: bool) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Bounds of the height scan and of the depth camera, empty without them."""
    scan, depth = (options.get(name) for name in ("scan", "depth"))
    no_numbers = np.zeros(0, dtype=np.float32)
    heights = depths = (no_numbers, no_numbers)
    if scan is not None:
        bound = SCALED_BOUND if scaled else SCAN_BOUND
        high = np.full(_count(scan, "points", SCAN_OPTIONS), bound, dtype=np.float32)
        heights = (-high, high)
    if depth is not None:
        far = 1.0 if scaled else _option(depth, "far", DEPTH_OPTIONS)
        high = np.full(_count(depth, "size", DEPTH_OPTIONS), far, dtype=np.float32)
        depths = (np.zeros_like(high), high)
    return heights, depths


def _option(given: Mapping[str, Any], name: str, known: Iterable[Mapping[str, Any]]) -> Any:
    return given.get(name, next(option["default"] for option in known if option["name"] == name))


def _count(given: Mapping[str, Any], name: str, known: Iterable[Mapping[str, Any]]) -> int:
    """How many numbers a sensor reads."""
    return math.prod(int(count) for count in np.broadcast_to(_option(given, name, known), 2))
