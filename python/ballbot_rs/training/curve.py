"""Evaluations during training, as runs leave them behind. Needs neither torch nor Stable-Baselines3."""

import dataclasses
import json
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Curve:
    """One run: rows are evaluations, columns their episodes."""

    folder: Path
    seed: int
    #: Text of the configuration; runs that share it differ by their seeds alone.
    config: str
    #: Environment steps before each evaluation.
    timesteps: Array
    returns: Array
    #: 1 for an episode that ended in success, else 0.
    successes: Array


def read(folder: Path) -> Curve:
    """The evaluations of a run.

    Raises:
        FileNotFoundError: there is no run, or it has not been evaluated yet.
        ValueError: what it left behind cannot be read.
    """
    if not (folder / "run.json").is_file():
        raise FileNotFoundError(f"{folder} holds no training run")
    if not (folder / "evaluations.npz").is_file():
        raise FileNotFoundError(f"{folder} has no evaluations yet")
    try:
        with np.load(folder / "evaluations.npz") as kept:
            timesteps, returns, successes = (kept[name].astype(float) for name in ("timesteps", "results", "successes"))
        seed = int(json.loads((folder / "run.json").read_text(encoding="utf-8"))["seed"])
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        # What NumPy says of a damaged file is advice to read it as a pickle.
        raise ValueError(f"{folder}: its evaluations cannot be read, run.json or evaluations.npz is damaged") from error
    config = (folder / "config.toml").read_text(encoding="utf-8")
    return Curve(folder, seed, config, timesteps, returns, successes)


def by_configuration(curves: Sequence[Curve]) -> list[list[Curve]]:
    """Runs of the same configuration together, in the order in which they are given."""
    groups: dict[str, list[Curve]] = {}
    for curve in curves:
        groups.setdefault(curve.config, []).append(curve)
    return list(groups.values())


def on_common_steps(curves: Sequence[Curve], name: str) -> tuple[Array, Array]:
    """Timesteps, and a row of means over the episodes for each run, up to the end of the shortest run."""
    end = min(curve.timesteps[-1] for curve in curves)
    grid = np.unique(np.concatenate([curve.timesteps for curve in curves]))
    grid = grid[grid <= end]
    means = [np.interp(grid, curve.timesteps, getattr(curve, name).mean(axis=1)) for curve in curves]
    return grid, np.array(means)
