"""Learning curves, from the evaluations of runs. Needs neither torch nor Stable-Baselines3."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ballbot_rs.training import run_folder

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Curve:
    """One run: rows are evaluations, columns their episodes."""

    folder: Path
    seed: int
    #: Text of the configuration; runs that share it differ only in their seeds.
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
        ValueError: one of its files is damaged; the message names the file.
    """
    seed = run_folder.read_record(folder)["seed"]
    kept = run_folder.read_evaluations(folder)
    if kept is None or not len(kept.timesteps):
        raise FileNotFoundError(f"{folder} has no evaluations yet")
    return Curve(folder, seed, run_folder.read_config_text(folder), kept.timesteps, kept.returns, kept.successes)


def by_configuration(curves: Sequence[Curve]) -> list[list[Curve]]:
    """Runs grouped by configuration, in the given order."""
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
