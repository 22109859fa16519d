"""A search of training hyperparameters with Optuna: several processes work in one folder, and any may leave.

Each trial is a training run in a separate folder; its score is the best mean return of its evaluations.
"""

import dataclasses
import json
import logging
import os
import re
import shutil
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np
import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, TrialState

from ballbot_rs import _files
from ballbot_rs.training import config as config_module
from ballbot_rs.training import run_folder, train

#: Files of a search.
JOURNAL, BEST = "journal.log", "best.toml"
#: Name of the study in the journal.
STUDY = "search"
#: How long the lock of a killed process holds, s.
GRACE = 5
#: Number of trials before any is pruned, and of evaluations before a trial is pruned.
STARTUP_TRIALS, STARTUP_EVALUATIONS = 5, 1
#: Keys that would change the meaning of the score.
FIXED: Final = ("env", "evaluation", "reward_scale", "env_id", "algorithm", "total_timesteps", "max_timesteps")

#: Default search space of PPO, in the format of `dimension_of`.
DEFAULT_SPACE: Final[Mapping[str, str]] = {
    "algorithm_arguments.learning_rate": "1e-5:1e-2:log",
    "algorithm_arguments.n_steps": "[16, 32, 64, 128]",
    "algorithm_arguments.batch_size": "[512, 1024, 2048, 4096, 8192]",
    "algorithm_arguments.n_epochs": "2:10",
    "algorithm_arguments.gamma": "[0.95, 0.97, 0.98, 0.99, 0.995, 0.997, 0.999]",
    "algorithm_arguments.gae_lambda": "[0.9, 0.92, 0.95, 0.97, 0.99]",
    "algorithm_arguments.ent_coef": "1e-6:1e-2:log",
    "policy.log_std_init": "-3.0:0.0",
}

_RANGE = re.compile(r"(?P<low>[^:\[\]]+):(?P<high>[^:\[\]]+?)(?P<log>:log)?")

Value = bool | int | float | str


@dataclasses.dataclass(frozen=True)
class Dimension:
    """Values of a hyperparameter: one of `choices`, or from `low` to `high`."""

    choices: tuple[Value, ...] = ()
    low: float = 0.0
    high: float = 0.0
    is_log: bool = False
    is_whole: bool = False

    def suggest(self, trial: optuna.Trial, name: str) -> Value:
        """The value of a trial."""
        if self.choices:
            value = trial.suggest_categorical(name, self.choices)
            assert value is not None
            return value
        if self.is_whole:
            return trial.suggest_int(name, int(self.low), int(self.high), log=self.is_log)
        return trial.suggest_float(name, self.low, self.high, log=self.is_log)

    @property
    def ends(self) -> tuple[Value, ...]:
        """The extreme values: a configuration that accepts them accepts all."""
        if self.choices:
            return self.choices
        return (int(self.low), int(self.high)) if self.is_whole else (self.low, self.high)


def dimension_of(name: str, text: str) -> Dimension:
    """A dimension from LOW:HIGH, LOW:HIGH:log or a list of values.

    Raises:
        ValueError: the text is none of these, or the range is empty or has no logarithm.
    """
    expected = "expected LOW:HIGH, LOW:HIGH:log or a list as [1, 2, 4]"
    match = _RANGE.fullmatch(text.strip())
    if match is None:
        try:
            choices = json.loads(text, parse_constant=_reject)
        except ValueError:
            raise ValueError(f"{name}={text}: {expected}") from None
        plain = (bool, int, float, str)
        if not isinstance(choices, list) or not choices or not all(isinstance(choice, plain) for choice in choices):
            raise ValueError(f"{name}={text}: {expected}")
        return Dimension(tuple(choices))
    try:
        low, high = float(match["low"]), float(match["high"])
    except ValueError:
        raise ValueError(f"{name}={text}: {expected}") from None
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ValueError(f"{name}={text}: the range must be finite and its low end below its high one")
    is_log = match["log"] is not None
    if is_log and low <= 0.0:
        raise ValueError(f"{name}={text}: a logarithmic range must begin above 0")
    whole = re.compile(r"\s*[+-]?\d+\s*")
    return Dimension((), low, high, is_log, all(whole.fullmatch(match[end]) for end in ("low", "high")))


def _reject(constant: str) -> None:
    raise ValueError(f"{constant} is not a finite number")


@dataclasses.dataclass(frozen=True)
class Search:
    """Search space, folder and length of a search.

    Raises:
        ValueError: the configuration does not accept the searched values, or the score would change its meaning.
    """

    #: The training configuration as TOML text.
    text: str
    space: Mapping[str, Dimension]
    folder: Path
    #: Total number of trials that end, pruned or not.
    trials: int
    seed: int = 0
    #: Number of this process among the concurrent processes.
    worker: int = 0

    def __post_init__(self) -> None:
        for name, dimension in self.space.items():
            if name.partition(".")[0] in FIXED:
                raise ValueError(f"{name} cannot be searched: trials would not be comparable")
            for value in dimension.ends:
                config_module.parse(config_module.with_values(self.text, {name: value}), "the configuration")

    def study(self) -> optuna.Study:
        """The study of the folder, made if missing.

        Raises:
            ValueError: the folder has another search, or is not a folder.
            OSError: it cannot be read or written.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise ValueError(f"{self.folder} is a file: name a folder with --study")
        self.folder.mkdir(parents=True, exist_ok=True)
        _quiet()
        path = self.folder / JOURNAL
        lock = JournalFileOpenLock(str(path), GRACE)
        _mend(path, lock)
        try:
            study = optuna.create_study(
                study_name=STUDY,
                storage=JournalStorage(JournalFileBackend(str(path), lock)),
                pruner=optuna.pruners.MedianPruner(STARTUP_TRIALS, STARTUP_EVALUATIONS),
                direction="maximize",
                load_if_exists=True,
            )
        except (json.JSONDecodeError, KeyError) as error:
            raise ValueError(f"{path} is not a search's journal ({error}): name another folder with --study") from error
        mine = {"configuration": self.text, "space": {name: str(one) for name, one in self.space.items()}}
        theirs = study.user_attrs
        for name, value in mine.items():
            if name in theirs and theirs[name] != value:
                raise ValueError(f"{self.folder} has a search with another {name}: name another folder with --study")
            if name not in theirs:
                study.set_user_attr(name, value)
        # Processes with the same samples would run the same trials.
        drawn = self.seed + 7919 * len(study.get_trials(deepcopy=False)) + 104_729 * self.worker
        study.sampler = optuna.samplers.TPESampler(seed=drawn % 2**32)
        return study

    def work(self, tell: Callable[[str], None] = lambda text: None) -> None:  # noqa: ARG005
        """Runs trials until all processes together have enough.

        Raises:
            ValueError: an invalid training configuration.
            OSError: a file cannot be written.
        """
        study = self.study()
        while len(ended(study)) < self.trials:
            study.optimize(lambda trial: self._score(trial, tell), n_trials=1)

    def _score(self, trial: optuna.Trial, tell: Callable[[str], None]) -> float:
        values = {name: dimension.suggest(trial, name) for name, dimension in self.space.items()}
        text = config_module.with_values(self.text, values)
        # All trials have the same number of steps.
        config = dataclasses.replace(config_module.parse(text, f"trial {trial.number}"), max_timesteps=None)
        folder = self.folder / f"trial-{trial.number:04}"
        if folder.exists():
            raise FileExistsError(
                f"{folder} is in the way of trial {trial.number}: move it, or search with --study in another folder"
            )
        trial.set_user_attr("folder", folder.name)

        def has_no_prospect(timesteps: int, mean_return: float) -> bool:
            trial.report(mean_return, timesteps)
            return trial.should_prune()

        try:
            # With different seeds trials would be compared by luck.
            train.train(config, text, folder, seed=self.seed, progress_bar=False, stops=has_no_prospect)
        except ValueError as error:
            if not (folder / run_folder.RECORD).is_file():
                raise
            # Numbers that a learner cannot handle end only this trial.
            tell(f"trial {trial.number} failed: {error}")
            raise optuna.TrialPruned from error
        finally:
            for part in (run_folder.CHECKPOINTS, "tensorboard"):
                shutil.rmtree(folder / part, ignore_errors=True)
        found = run_folder.read_evaluations(folder)
        assert found is not None
        score = float(found.returns.mean(axis=1).max())
        if found.timesteps[-1] < config.total_timesteps:
            tell(f"trial {trial.number}: ended early at {found.timesteps[-1]:.0f} steps, return {score:.1f}")
            raise optuna.TrialPruned
        tell(f"trial {trial.number}: return {score:.1f}")
        return score

    def finish(self) -> list[FrozenTrial]:
        """Writes the configuration of the best trial; returns the trials that ran to their end, best first.

        Raises:
            ValueError: there is no such trial.
            OSError: the file cannot be written.
        """
        done = [trial for trial in self.study().get_trials(deepcopy=False) if trial.state == TrialState.COMPLETE]
        if not done:
            raise ValueError(f"{self.folder}: no trial has been completed")
        done.sort(key=lambda trial: -float(trial.value or 0.0))
        _files.write(self.folder / BEST, config_module.with_values(self.text, done[0].params))
        return done


def ended(study: optuna.Study) -> list[FrozenTrial]:
    """Finished trials, without interrupted trials."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))


def _mend(journal: Path, lock: JournalFileOpenLock) -> None:
    """Removes an incomplete last line, left by a killed process or a full disk."""
    if not journal.exists():
        return
    lock.acquire()
    try:
        kept = journal.read_bytes()
        if kept and not kept.endswith(b"\n"):
            os.truncate(journal, kept.rfind(b"\n") + 1)
    finally:
        lock.release()


def _quiet() -> None:
    optuna.logging.set_verbosity(logging.ERROR)
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)
