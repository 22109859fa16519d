"""A training run, from a configuration to a folder with the best policy in it."""

import contextlib
import dataclasses
import importlib
import math
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, Protocol

import gymnasium
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from ballbot_rs import _files
from ballbot_rs._core import Controller
from ballbot_rs._extras import require
from ballbot_rs.control import policy_size, sb3_policy, sb3_recurrent
from ballbot_rs.control.sb3_policy import METADATA, algorithms, metadata
from ballbot_rs.envs._batch_env import without_curriculum
from ballbot_rs.envs.family import at_most
from ballbot_rs.envs.registration import task_of
from ballbot_rs.envs.sb3 import BallbotVecEnv
from ballbot_rs.envs.spaces import observation_width
from ballbot_rs.training import config as config_module
from ballbot_rs.training import refinement, run_folder, run_state, teacher, tied
from ballbot_rs.training.callbacks import BetweenRollouts, Checkpoints, Ended, KeepBest, ProgressBar
from ballbot_rs.training.checkpoint import restore_newest
from ballbot_rs.training.config import TrainConfig
from ballbot_rs.training.scaled_rewards import ScaledRewards
from ballbot_rs.training.seeds import EVALUATION_SEEDS, JUDGED, first_seed

VERSIONS: Final = {
    "gymnasium": gymnasium.__version__,
    "stable_baselines3": stable_baselines3.__version__,
    "torch": str(torch.__version__),
}


@dataclasses.dataclass(frozen=True)
class Session:
    """The model to train, and its callbacks."""

    model: BaseAlgorithm
    config: TrainConfig
    seed: int
    #: Most steps after the model's `num_timesteps`; `keep_best` may end it earlier.
    timesteps: int
    checkpoints: Checkpoints
    keep_best: KeepBest
    #: Steps of all environments between two evaluations, and between two checkpoints.
    every: int
    progress_bar: bool


class Learn(Protocol):
    """A training loop."""

    def check(self, config: TrainConfig) -> None:
        """Rejects a configuration that the loop does not support, before anything is written.

        Raises:
            ValueError: the loop does not support it.
        """

    def __call__(self, session: Session) -> None:
        """Learns: updates the weights and `num_timesteps` of the model."""


def train(
    config: TrainConfig,
    text: str,
    folder: Path,
    *,
    seed: int = 0,
    overwrite: bool = False,
    progress_bar: bool = True,
    tell: Callable[[str], None] = lambda text: None,  # noqa: ARG005
    stops: Callable[[int, float], bool] | None = None,
    learn: Learn | None = None,
) -> Path:
    """Trains a policy and returns its file.

    Args:
        config: the configuration.
        text: its TOML text, kept in the folder.
        folder: the run folder; must not exist yet or be empty.
        seed: seeds the environments and the learner.
        overwrite: whether to delete an earlier run in `folder`.
        progress_bar: whether to show a progress bar.
        tell: called with a text about the fit to a teacher.
        stops: called with the steps and the mean return of each evaluation; True ends training.
        learn: the training loop; None is the loop of Stable-Baselines3.

    Raises:
        FileExistsError: the folder has an earlier run.
        ValueError: the configuration does not fit the environment or the algorithm, or another process trains in the
            folder.
        OSError: a file cannot be written.
    """
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed = {seed} is out of range: it must be from 0 to 2**32 - 1")
    run_folder.check(folder, overwrite)
    torch.set_num_threads(config.torch_threads)
    if learn is not None:
        learn.check(config)
    # Before anything is deleted or written: this rejects an invalid configuration.
    model = _new_model(config, folder, seed)
    ties = _tie(model, config, tell, learn)
    law = None if config.teacher is None else teacher.best_law(model, config.teacher, seed, tell)
    trials = _trials(model, config, law, seed)
    with run_folder.held(folder):
        run_folder.begin(folder, text, seed, overwrite=overwrite, versions=VERSIONS)
        keep_best = _keep_best(config, folder, seed, stops)
        if config.teacher is not None and law is not None:
            began = time.perf_counter()
            with _without_integral(model, config, seed):
                teacher.fit(model, law, config.teacher, seed, tell, ties)
            run_folder.add_fit_time(folder, time.perf_counter() - began)
            if trials is not None and ties is not None:
                Checkpoints(folder / run_folder.FIT).keep(model, is_due=False)
                _refine(model, trials, ties, seed, tell, folder)
            else:
                Checkpoints(folder).keep(model)
            # The fitted policy may stay the best one.
            keep_best.evaluate(model)
        return _learn(_session(model, config, folder, seed, keep_best, progress_bar), folder, learn)


def resume(
    folder: Path,
    *,
    timesteps: int | None = None,
    progress_bar: bool = True,
    tell: Callable[[str], None] = lambda text: None,  # noqa: ARG005
    learn: Learn | None = None,
) -> Path:
    """Continues a run from its newest readable checkpoint to its configured number of steps.

    A checkpoint that cannot be read is skipped with a `UserWarning`. No code in the checkpoint is run. Evaluations
    after the checkpoint are dropped; the best policy stays, whenever it was found. The resumed run is bit-identical to
    the uninterrupted run. Where it is not, `tell` gets the reason: on Ray, for a task in Python, after a checkpoint of
    another version, or after an error within a rollout, robots begin new episodes.

    Args:
        folder: the run.
        timesteps: a new total number of steps of the run; a finished run continues for the difference.
        progress_bar: whether to show a progress bar.
        tell: called with a text that names the checkpoint.
        learn: the training loop, whichever the run had so far; None is the loop of Stable-Baselines3.

    Raises:
        FileNotFoundError: the folder has no run, or a run without a checkpoint.
        ValueError: a file of the run is damaged (the message names it); no checkpoint can be read; another process
            trains in the folder; or a run of SAC, whose replay buffer is not kept.
        OSError: a file cannot be read or written.
    """
    run_folder.read_record(folder)
    with run_folder.held(folder):
        _files.delete_remains(folder)
        return _resume(folder, timesteps, progress_bar, tell, learn)


def _resume(
    folder: Path, timesteps: int | None, progress_bar: bool, tell: Callable[[str], None], learn: Learn | None
) -> Path:
    seed = run_folder.read_record(folder)["seed"]
    text = run_folder.read_config_text(folder)
    source = str(folder / run_folder.CONFIG)
    config = config_module.parse(text, source)
    if timesteps is not None:
        text = config_module.with_values(text, config_module.steps_alone(config, timesteps))
        config = config_module.parse(text, source)
    if config.algorithm == "SAC":
        raise ValueError("a SAC run cannot be resumed: its replay buffer is not kept")
    if learn is not None:
        learn.check(config)
    past = run_folder.read_evaluations(folder)
    if past is not None and past.returns.shape[1] != config.evaluation.episodes:
        raise ValueError(
            f"{source}: evaluation.episodes = {config.evaluation.episodes}, but the evaluations of the run so far "
            f"have {past.returns.shape[1]}"
        )
    torch.set_num_threads(config.torch_threads)
    model = _new_model(config, folder, seed)
    is_fitted = not run_folder.checkpoints(folder) and bool(run_folder.checkpoints(folder / run_folder.FIT))
    if not is_fitted:
        # Of a refinement whose process ended when it had kept the result.
        shutil.rmtree(folder / run_folder.FIT, ignore_errors=True)
    trials = None
    if is_fitted and config.teacher is not None:
        trials = _trials(model, config, teacher.best_law(model, config.teacher, seed, tell), seed)
    checkpoint = restore_newest(model, folder / run_folder.FIT if is_fitted else folder)
    ties = _tie(model, config, tell, learn, is_new=False)
    if timesteps is not None and timesteps < model.num_timesteps:
        raise ValueError(f"timesteps = {timesteps}: the run has already done {model.num_timesteps} steps")
    keep_best = _keep_best(config, folder, seed)
    keep_best.remember(past, model.num_timesteps, task_of(config.env_id))
    tell(f"resuming from {checkpoint}")
    _files.delete_remains(checkpoint.parent)
    if timesteps is not None:
        _files.write(folder / run_folder.CONFIG, text)
    continues = learn is None and _give_state(model, checkpoint, keep_best, tell)
    if not continues:
        # The start of the run used the first random numbers: continue with others.
        model.set_random_seed(seed + model.num_timesteps)
        model._last_obs = None
        run_state.seed_environments(model, first_seed(seed) + model.num_timesteps % EVALUATION_SEEDS)
    if trials is not None and ties is not None:
        _refine(model, trials, ties, seed, tell, folder)
    if is_fitted or not continues:
        keep_best.evaluate(model)
    return _learn(_session(model, config, folder, seed, keep_best, progress_bar), folder, learn)


def _trials(model: BaseAlgorithm, config: TrainConfig, law: Controller | None, seed: int) -> refinement.Trials | None:
    """What a refinement tries policies on; whatever is invalid there is named before the fit."""
    if config.refinement is None:
        return None
    trials = refinement.Trials(config, config.refinement, seed)
    refinement.network_of(model)
    assert law is not None
    trials.measure(law)
    return trials


def _refine(
    model: BaseAlgorithm,
    trials: refinement.Trials,
    ties: tied.Ties,
    seed: int,
    tell: Callable[[str], None],
    folder: Path,
) -> None:
    """Refines a fitted policy, from where an earlier process ended, and keeps it in the run in place of the fit."""
    fit, began = folder / run_folder.FIT, time.perf_counter()
    refinement.refine(model, trials, ties, seed, tell, fit / run_folder.OBJECTIVE)
    run_folder.add_fit_time(folder, time.perf_counter() - began)
    Checkpoints(folder).keep(model)
    shutil.rmtree(fit, ignore_errors=True)


def _give_state(model: BaseAlgorithm, checkpoint: Path, keep_best: KeepBest, tell: Callable[[str], None]) -> bool:
    """Restores a model's state in the run; returns False, and why, if that is impossible."""
    try:
        state = run_state.read(checkpoint)
        if state is None:
            raise ValueError("the checkpoint has no state of its robots")
        if state["is_due"]:
            keep_best.evaluate(model)
        run_state.give(model, state)
    except (ValueError, KeyError) as error:
        tell(f"the run continues, but not bit-identical to an uninterrupted run: {error}")
        return False
    return True


def _environment(config: TrainConfig) -> VecEnv:
    environment = VecMonitor(
        BallbotVecEnv(
            config.num_envs,
            task=task_of(config.env_id),
            torch_threads=None,
            num_threads=config.num_threads,
            stagger=True,
            **config.env,
        )
    )
    return environment if config.reward_scale == 1.0 else ScaledRewards(environment, config.reward_scale)


@contextlib.contextmanager
def _without_integral(model: BaseAlgorithm, config: TrainConfig, seed: int) -> Iterator[None]:
    """Gives a model environments in which the position error is observed as it is, as a teacher's law acts on it."""
    if not config.env.get("integral_rate"):
        yield
        return
    whole = model.env
    assert whole is not None
    plain = _environment(dataclasses.replace(config, env={**config.env, "integral_rate": 0.0}))
    model.set_env(plain)
    run_state.seed_environments(model, first_seed(seed))
    try:
        yield
    finally:
        model.set_env(whole)
        plain.close()


def _linear(initial: float, total: int, most: int) -> Callable[[float], float]:
    """A value that falls to zero within `total` steps, and again within as many if the run continues to `most`."""

    def value(remaining: float) -> float:
        if total == most:
            return initial * remaining
        done = (1.0 - remaining) * most / total
        return initial * (math.ceil(done) - done) if done > 0.0 else initial

    return value


def _constant(initial: float, total: int, most: int) -> Callable[[float], float]:
    """A rate that is constant for `total` steps, and falls as one over the steps if the run continues to `most`."""
    return lambda remaining: initial * min(1.0, total / max((1.0 - remaining) * most, 1.0))


def _new_model(config: TrainConfig, folder: Path, seed: int) -> BaseAlgorithm:
    try:
        environment = _environment(config)
        arguments: dict[str, Any] = config.arguments()
        rate = arguments.get("learning_rate")
        if isinstance(rate, (int, float)) and config.most_timesteps > config.total_timesteps:
            arguments["learning_rate"] = _constant(float(rate), config.total_timesteps, config.most_timesteps)
        for name in config.schedule:
            arguments[name] = _linear(
                float(config.algorithm_arguments[name]), config.total_timesteps, config.most_timesteps
            )
        width = observation_width(task_of(config.env_id), config.env)
        policy_size.check(config.policy, width, config.algorithm)
        if config.teacher is not None:
            teacher.check_size(config.teacher, config.num_envs, width)
        if config.algorithm == policy_size.RECURRENT:
            with require(f"algorithm = {config.algorithm}", "train"):
                importlib.import_module("sb3_contrib")
        model: BaseAlgorithm = algorithms()[config.algorithm](
            sb3_recurrent.POLICY if config.algorithm == policy_size.RECURRENT else "MlpPolicy",
            environment,
            policy_kwargs=dict(config.policy),
            tensorboard_log=str(folder / "tensorboard"),
            seed=seed,
            device="cpu",
            **arguments,
        )
    except (TypeError, AssertionError, RuntimeError, MemoryError) as error:
        raise ValueError(f"the configuration does not fit {config.algorithm}: {error}") from error
    # The learner has seeded the environments with its own seed.
    run_state.seed_environments(model, first_seed(seed))
    (options,) = environment.get_attr("task_options", [0])
    setattr(model, METADATA, metadata(task_of(config.env_id), config.algorithm, options))
    return model


def _tie(
    model: BaseAlgorithm, config: TrainConfig, tell: Callable[[str], None], learn: Learn | None, *, is_new: bool = True
) -> tied.Ties | None:
    """Ties the weights of a model if the configuration requires it; another training loop has its own weights."""
    if learn is None:
        return tied.tie(model, config.symmetric, tell, odd=config.odd, is_new=is_new)
    if config.symmetric:
        tell("the policy is not symmetric: this training loop does not tie weights")
    return None


def _keep_best(
    config: TrainConfig, folder: Path, seed: int, stops: Callable[[int, float], bool] | None = None
) -> KeepBest:
    options = without_curriculum(config.env)
    nominal = {name: value for name, value in options.items() if name != "events"}
    first = first_seed(seed) + EVALUATION_SEEDS

    def environments(count: int, options: dict[str, Any]) -> VecEnv:
        if "robot" in options:
            options = {**options, "robot": at_most(options["robot"], count)}
        return VecMonitor(
            BallbotVecEnv(
                count,
                task=task_of(config.env_id),
                torch_threads=None,
                num_threads=config.num_threads,
                seed=first,
                **options,
            )
        )

    return KeepBest(
        folder,
        environments(config.evaluation.episodes, options),
        environments(JUDGED, nominal),
        seed=first,
        episodes=config.evaluation.episodes,
        success=config.evaluation.success,
        total_timesteps=config.total_timesteps,
        stops=stops,
    )


def _every(config: TrainConfig) -> int:
    """Steps of all environments between two evaluations, and between two checkpoints."""
    return max(config.evaluation.every_timesteps // config.num_envs, 1)


def _session(
    model: BaseAlgorithm, config: TrainConfig, folder: Path, seed: int, keep_best: KeepBest, progress_bar: bool
) -> Session:
    every = _every(config)
    return Session(
        model=model,
        config=config,
        seed=seed,
        timesteps=config.most_timesteps - model.num_timesteps,
        checkpoints=Checkpoints(folder),
        keep_best=keep_best,
        every=every * config.num_envs,
        progress_bar=progress_bar,
    )


def _with_sb3(session: Session) -> None:
    between = BetweenRollouts(session.checkpoints, session.keep_best, session.every)
    bars = [ProgressBar(session.config.total_timesteps)] if session.progress_bar else []
    try:
        session.model.learn(session.timesteps, callback=[between, *bars], reset_num_timesteps=False)
    except Ended:
        between.end_rollout()
        for shown in bars:
            shown.on_training_end()
    finally:
        between.abandon()


def _learn(session: Session, folder: Path, learn: Learn | None) -> Path:
    model, started, diverged, ended = session.model, time.perf_counter(), "", False
    if session.timesteps > 0:
        # Another training loop has its own robots.
        session.checkpoints.is_between_rollouts = learn is None
        try:
            (learn or _with_sb3)(session)
            ended = True
        except ValueError as error:
            # Torch rejects an invalid action distribution, and prints the whole batch.
            reason, diverged, _ = str(error).partition(" (Tensor of shape")
            if not diverged:
                raise
            raise ValueError(f"the training has diverged after {model.num_timesteps} steps: {reason}") from error
        finally:
            # After any other end the run can be resumed from here.
            if not diverged:
                session.checkpoints.keep(model, is_due=ended)
            run_folder.add_time(folder, model.num_timesteps, time.perf_counter() - started)
    # The last policy is often the best one.
    session.keep_best.evaluate(model)
    sb3_policy.write(model, folder / run_folder.FINAL)
    required = session.config.evaluation.success
    if required is not None:
        record = run_folder.read_record(folder)
        reached = session.keep_best.success_of_best()
        run_folder.write_record(folder, {**record, "success": reached, "required_success": float(required)})
    return folder / run_folder.BEST
