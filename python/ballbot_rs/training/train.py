"""A training run, from a configuration to a folder with the best policy in it."""

import json
import platform
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import CheckpointCallback, EvalCallback
from stable_baselines3.common.vec_env import VecMonitor

import ballbot_rs
from ballbot_rs.control.sb3_policy import METADATA, algorithms, metadata
from ballbot_rs.envs.registration import task_of
from ballbot_rs.envs.sb3 import BallbotVecEnv
from ballbot_rs.training import config as config_module
from ballbot_rs.training.config import TrainConfig

#: Seeds of environments: each run has its own range, evaluations have its end, and `compare` stays below all of them.
SEEDS_PER_RUN = 10_000_000
EVALUATION_SEEDS = 9_000_000


def _first_seed(seed: int) -> int:
    return SEEDS_PER_RUN * (seed + 1)


def train(
    config: TrainConfig,
    text: str,
    folder: Path,
    *,
    seed: int = 0,
    overwrite: bool = False,
    progress_bar: bool = True,
) -> Path:
    """Trains a policy and returns its file.

    Args:
        config: the configuration.
        text: its TOML text, kept in the folder.
        folder: where the run is kept; must not exist yet or be empty.
        seed: seeds the environments and the learner.
        overwrite: whether to delete what an earlier run left in `folder`.
        progress_bar: whether to show one.

    Raises:
        FileExistsError: the folder holds an earlier run.
        ValueError: the configuration does not fit the environment or the algorithm.
    """
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed = {seed} is out of range: it must be from 0 to 2**32 - 1")
    if folder.exists() and any(folder.iterdir()):
        if not overwrite:
            raise FileExistsError(f"{folder} holds an earlier run: resume it, overwrite it, or name another")
        if not (folder / "run.json").is_file():
            raise FileExistsError(f"{folder} is not a training run, so it is not overwritten")
    torch.set_num_threads(config.torch_threads)
    # Before anything is deleted or written: this is what refuses a configuration.
    model = _new_model(config, folder, seed)
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(text, encoding="utf-8")
    _write_record(folder, seed)
    return _learn(model, config, folder, seed, config.total_timesteps, progress_bar)


def resume(folder: Path, *, timesteps: int | None = None, progress_bar: bool = True) -> Path:
    """Continues a run from its latest checkpoint to the number of steps that it was to have.

    The random numbers go on, but not where they were: a resumed run is not bit-identical to an uninterrupted one.

    Args:
        folder: the run.
        timesteps: the number of steps that the run is to have from now on; a finished run goes on for the difference.
        progress_bar: whether to show one.

    Raises:
        FileNotFoundError: the folder holds no run, or one without a checkpoint.
        ValueError: a run of SAC, whose replay buffer is not kept.
    """
    record = folder / "run.json"
    if not record.is_file():
        raise FileNotFoundError(f"{folder} holds no training run")
    seed = int(json.loads(record.read_text(encoding="utf-8"))["seed"])
    text = (folder / "config.toml").read_text(encoding="utf-8")
    if timesteps is not None:
        text = config_module.with_values(text, {"total_timesteps": timesteps})
    config = config_module.parse(text, str(folder / "config.toml"))
    checkpoints = sorted((folder / "checkpoints").glob("rl_model_*_steps.zip"), key=_steps_of)
    if config.algorithm == "SAC":
        raise ValueError("a SAC run cannot be resumed: its replay buffer is not kept")
    if not checkpoints:
        raise FileNotFoundError(f"{folder} has no checkpoint to resume from")
    (folder / "config.toml").write_text(text, encoding="utf-8")
    torch.set_num_threads(config.torch_threads)
    model = algorithms()[config.algorithm].load(checkpoints[-1], env=_environment(config), device="cpu")
    # Loading seeds everything as at the start of the run: go on with other numbers.
    model.set_random_seed(seed + model.num_timesteps)
    _seed_environments(model, _first_seed(seed) + model.num_timesteps % EVALUATION_SEEDS)
    remaining = config.total_timesteps - model.num_timesteps
    if remaining <= 0:
        return _finish(model, folder)
    return _learn(model, config, folder, seed, remaining, progress_bar)


def _environment(config: TrainConfig) -> VecMonitor:
    return VecMonitor(
        BallbotVecEnv(
            config.num_envs,
            task=task_of(config.env_id),
            torch_threads=None,
            num_threads=config.num_threads,
            stagger=True,
            **config.env,
        )
    )


def _seed_environments(model: BaseAlgorithm, seed: int) -> None:
    environment = model.get_env()
    if environment is not None:
        environment.seed(seed)


def _linear(initial: float) -> Callable[[float], float]:
    return lambda remaining: initial * remaining


def _new_model(config: TrainConfig, folder: Path, seed: int) -> BaseAlgorithm:
    arguments: dict[str, Any] = dict(config.algorithm_arguments)
    for name in config.schedule:
        arguments[name] = _linear(float(arguments[name]))
    try:
        environment = _environment(config)
        model: BaseAlgorithm = algorithms()[config.algorithm](
            "MlpPolicy",
            environment,
            policy_kwargs=dict(config.policy),
            tensorboard_log=str(folder / "tensorboard"),
            seed=seed,
            device="cpu",
            **arguments,
        )
    except (TypeError, AssertionError) as error:
        raise ValueError(f"the configuration does not fit {config.algorithm}: {error}") from error
    # The learner has seeded the environments with its own seed.
    _seed_environments(model, _first_seed(seed))
    (options,) = environment.get_attr("task_options", [0])
    setattr(model, METADATA, metadata(task_of(config.env_id), config.algorithm, options))
    return model


def _learn(
    model: BaseAlgorithm, config: TrainConfig, folder: Path, seed: int, timesteps: int, progress_bar: bool
) -> Path:
    every = max(config.evaluation.every_timesteps // config.num_envs, 1)
    evaluation = BallbotVecEnv(
        min(config.evaluation.episodes, 100),
        task=task_of(config.env_id),
        torch_threads=None,
        num_threads=config.num_threads,
        seed=_first_seed(seed) + EVALUATION_SEEDS,
        **config.env,
    )
    keep_best = EvalCallback(
        VecMonitor(evaluation),
        n_eval_episodes=config.evaluation.episodes,
        eval_freq=every,
        log_path=str(folder),
        best_model_save_path=str(folder),
        verbose=0,
    )
    _remember(keep_best, folder / "evaluations.npz")
    callbacks = [CheckpointCallback(every, str(folder / "checkpoints")), keep_best]
    try:
        model.learn(timesteps, callback=callbacks, reset_num_timesteps=False, progress_bar=progress_bar)
    finally:
        # Whatever ended it, the run can be resumed from here.
        checkpoint = folder / "checkpoints" / f"rl_model_{model.num_timesteps}_steps.zip"
        if not checkpoint.is_file():
            model.save(checkpoint)
    if keep_best.evaluations_timesteps[-1:] != [model.num_timesteps]:
        # The last policy has not been evaluated, and is often the best one.
        keep_best.eval_freq = 1
        keep_best.on_step()
    return _finish(model, folder)


def _remember(callback: EvalCallback, path: Path) -> None:
    """Gives the callback the evaluations before the interruption: only a better policy replaces the best one."""
    if not path.is_file():
        return
    with np.load(path) as past:
        callback.evaluations_timesteps = past["timesteps"].tolist()
        callback.evaluations_results = past["results"].tolist()
        callback.evaluations_length = past["ep_lengths"].tolist()
        callback.evaluations_successes = past["successes"].tolist()
        callback.best_mean_reward = float(past["results"].mean(axis=1).max())


def _finish(model: BaseAlgorithm, folder: Path) -> Path:
    model.save(folder / "final_model.zip")
    return folder / "best_model.zip"


def _steps_of(checkpoint: Path) -> int:
    return int(checkpoint.stem.split("_")[-2])


def _write_record(folder: Path, seed: int) -> None:
    record = {
        "seed": seed,
        "versions": {
            "ballbot_rs": ballbot_rs.__version__,
            "gymnasium": gymnasium.__version__,
            "stable_baselines3": stable_baselines3.__version__,
            "torch": str(torch.__version__),
            "python": platform.python_version(),
        },
    }
    (folder / "run.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
