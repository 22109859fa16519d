"""State of a run between two rollouts, in addition to its weights: random numbers and robots.

With it a resumed run is bit-identical to an uninterrupted run.
"""

import contextlib
import io
import random
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecMonitor, unwrap_vec_wrapper

from ballbot_rs.control import sb3_recurrent
from ballbot_rs.envs.sb3 import BallbotVecEnv

#: Name within a checkpoint.
ENTRY: Final = "run_state.npz"

State = Mapping[str, npt.NDArray[Any]]


def seed_environments(model: BaseAlgorithm, seed: int) -> None:
    """Gives a model's environments seeds from `seed` on, from their next reset."""
    environment = model.get_env()
    if environment is not None:
        environment.seed(seed)


def taken(model: BaseAlgorithm, is_due: bool) -> bytes | None:
    """The state of a model between two rollouts; None for tasks and functions in Python that have a memory.

    Args:
        model: a model that learns.
        is_due: whether an evaluation follows.
    """
    environment = _robots_of(model)
    if (stage := environment._batch.stage) is not None and stage.has_memory:
        return None
    snapshots = [environment._batch.snapshot(i) for i in range(environment.num_envs)]
    monitor = _monitor_of(model)
    state = {
        **_random_numbers(),
        "is_due": np.array(is_due),
        "robots": np.frombuffer(b"".join(snapshots), dtype=np.uint8),
        "sizes": np.array([len(snapshot) for snapshot in snapshots]),
        # Of the next reset; -1 continues with the robots' own random numbers.
        "seeds": np.array([-1 if seed is None else seed for seed in environment._seeds]),
        "episode_returns": monitor.episode_returns,
        "episode_lengths": monitor.episode_lengths,
        "episode_count": np.array(monitor.episode_count),
    }
    if model._last_obs is not None:
        state |= {"observations": np.asarray(model._last_obs), "episode_starts": np.asarray(model._last_episode_starts)}
    if sb3_recurrent.is_recurrent(model):
        state |= sb3_recurrent.states_of_learner(model)
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **state)
    return content.getvalue()


def read(checkpoint: Path) -> State | None:
    """The state in a checkpoint; None without a state.

    Raises:
        ValueError: it cannot be read.
    """
    with zipfile.ZipFile(checkpoint) as archive:
        if ENTRY not in archive.namelist():
            return None
        with np.load(io.BytesIO(archive.read(ENTRY))) as found:
            return dict(found)


def give(model: BaseAlgorithm, state: State) -> None:
    """Restores the state in a new model and in Python.

    Raises:
        ValueError: the state is of another configuration or version, or damaged.
    """
    environment, monitor = _robots_of(model), _monitor_of(model)
    try:
        ends = np.cumsum(state["sizes"])
        if len(ends) != environment.num_envs:
            raise ValueError(f"it has {len(ends)} robots, expected {environment.num_envs}")
        for i, snapshot in enumerate(np.split(state["robots"], ends[:-1])):
            environment._batch.restore(i, snapshot.tobytes())
        if "seeds" in state:
            environment._seeds = [None if seed < 0 else seed for seed in state["seeds"].tolist()]
        monitor.episode_returns = state["episode_returns"].copy()
        monitor.episode_lengths = state["episode_lengths"].copy()
        monitor.episode_count = int(state["episode_count"])
        if "observations" in state:
            model._last_obs = state["observations"].copy()
            model._last_episode_starts = state["episode_starts"].copy()
        if sb3_recurrent.is_recurrent(model):
            sb3_recurrent.give_states_to_learner(model, state)
        _set_random_numbers(state)
    except (KeyError, TypeError, IndexError, RuntimeError) as error:
        raise ValueError(str(error)) from error


@contextlib.contextmanager
def same_random_numbers() -> Iterator[None]:
    """A context that restores the random states of Python, NumPy and torch, since loading a model seeds them."""
    before = _random_numbers()
    try:
        yield
    finally:
        _set_random_numbers(before)


def _random_numbers() -> dict[str, npt.NDArray[Any]]:
    # Stable-Baselines3 shuffles with NumPy's global generator.
    _, keys, place, has_normal, normal = np.random.get_state(legacy=True)  # noqa: NPY002
    _, numbers, python_normal = random.getstate()
    return {
        "torch": torch.get_rng_state().numpy().copy(),
        "numpy": np.asarray(keys),
        "numpy_rest": np.array([place, has_normal, normal]),
        "python": np.array(numbers),
        "python_normal": np.array(np.nan if python_normal is None else python_normal),
    }


def _set_random_numbers(state: State) -> None:
    place, has_normal, normal = state["numpy_rest"].tolist()
    np.random.set_state(("MT19937", state["numpy"], int(place), int(has_normal), normal))  # noqa: NPY002
    normal = float(state["python_normal"])
    random.setstate((3, tuple(map(int, state["python"])), None if np.isnan(normal) else normal))
    torch.set_rng_state(torch.from_numpy(state["torch"].copy()))


def _robots_of(model: BaseAlgorithm) -> BallbotVecEnv:
    environment = model.get_env()
    assert environment is not None
    robots = environment.unwrapped
    assert isinstance(robots, BallbotVecEnv)
    return robots


def _monitor_of(model: BaseAlgorithm) -> VecMonitor:
    environment = model.get_env()
    assert environment is not None
    monitor = unwrap_vec_wrapper(environment, VecMonitor)
    assert isinstance(monitor, VecMonitor)
    return monitor
