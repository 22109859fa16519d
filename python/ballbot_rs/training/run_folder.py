"""The files of a training run: their paths, and readers. Needs neither torch nor Stable-Baselines3."""

import contextlib
import dataclasses
import io
import json
import platform
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs import __version__, _files
from ballbot_rs.training.origin import now, origin

Array = npt.NDArray[np.float64]

RECORD = "run.json"
CONFIG = "config.toml"
EVALUATIONS = "evaluations.npz"
BEST = "best_model.zip"
FINAL = "final_model.zip"
CHECKPOINTS = "checkpoints"
#: Folder of what a refinement continues from, until it ends: a checkpoint of the fit, and the objective so far.
FIT = "fit"
OBJECTIVE = "objective.json"
#: Held by the process that trains.
LOCK = ".lock"


@dataclasses.dataclass(frozen=True)
class Evaluations:
    """Evaluations during training: rows are evaluations, columns their episodes."""

    #: Environment steps before each evaluation, shape (n,).
    timesteps: Array
    #: Return of each episode, shape (n, m).
    returns: Array
    #: Steps of each episode, shape (n, m).
    lengths: Array
    #: 1 for an episode that ended in success, else 0, shape (n, m).
    successes: Array

    def up_to(self, timesteps: int) -> "Evaluations":
        """The evaluations up to this number of steps."""
        kept = self.timesteps <= timesteps
        return Evaluations(self.timesteps[kept], self.returns[kept], self.lengths[kept], self.successes[kept])

    def followed_by(self, other: "Evaluations") -> "Evaluations":
        """The evaluations of both, which must have the same number of episodes."""
        columns = (dataclasses.astuple(self), dataclasses.astuple(other))
        return Evaluations(*(np.concatenate(pair) for pair in zip(*columns, strict=True)))

    def save(self, folder: Path) -> None:
        """Writes them into a run, with the array names of Stable-Baselines3.

        Raises:
            OSError: the file cannot be written.
        """
        content = io.BytesIO()
        np.savez(
            content,
            timesteps=self.timesteps.astype(np.int64),
            results=self.returns,
            ep_lengths=self.lengths.astype(np.int64),
            successes=self.successes.astype(bool),
        )
        _files.write(folder / EVALUATIONS, content.getvalue())


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """A context in which no other process trains in a folder, which is made if needed.

    The lock ends with the process, however it ends; its file stays.

    Raises:
        ValueError: another process trains there.
        OSError: the folder cannot be written.
    """
    import filelock

    folder.mkdir(parents=True, exist_ok=True)
    lock = filelock.FileLock(folder / LOCK)
    try:
        lock.acquire(blocking=False)
    except filelock.Timeout:
        raise ValueError(f"{folder}: another process is training there") from None
    try:
        yield
    finally:
        lock.release()


def check(folder: Path, overwrite: bool) -> None:
    """Rejects a folder in which a run must not begin.

    Raises:
        FileExistsError: it has an earlier run that must not be overwritten, or other files.
        OSError: it cannot be read.
    """
    if not folder.exists():
        return
    if all(path.name == LOCK or _files.is_remains(path) for path in folder.iterdir()):
        return
    if not (folder / RECORD).is_file():
        raise FileExistsError(
            f"{folder} is not a training run, so it is not overwritten: name another folder with --run"
        )
    if not overwrite:
        raise FileExistsError(
            f"{folder} holds an earlier run: continue it with --resume, delete it with --overwrite, or name another "
            "folder with --run"
        )


def begin(folder: Path, text: str, seed: int, *, overwrite: bool, versions: Mapping[str, str]) -> None:
    """Begins a run in a folder that this process holds.

    Args:
        folder: the run.
        text: of its configuration.
        seed: of the run.
        overwrite: whether to delete an earlier run.
        versions: of the libraries that train.

    Raises:
        FileExistsError: as `check`.
        OSError: a file cannot be written.
    """
    # Another process may have begun a run in the meantime.
    check(folder, overwrite)
    _empty(folder)
    known = {"ballbot_rs": __version__, **versions, "python": platform.python_version()}
    # The record comes first: a folder with it is a run, which may be overwritten.
    write_record(folder, {"seed": seed, "versions": known, **origin()})
    _files.write(folder / CONFIG, text)


def _empty(folder: Path) -> None:
    """Deletes an earlier run, its record last: until then the folder counts as a run that may be overwritten."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name not in (RECORD, LOCK):
            path.unlink()


def read_record(folder: Path) -> dict[str, Any]:
    """The record of a run: its seed, its origin, and the software versions.

    Raises:
        FileNotFoundError: the folder has no run.
        ValueError: the record is damaged.
    """
    path = folder / RECORD
    if not path.is_file():
        raise FileNotFoundError(f"{folder} holds no training run: there is no {RECORD} in it")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    if not isinstance(record, dict) or not isinstance(record.get("seed"), int):
        raise ValueError(f"{path} is damaged: it must have the run's seed, a whole number")
    return record


def failure(record: Mapping[str, Any]) -> str | None:
    """Why a run has failed according to its record; None if it has not, or if it had no requirement."""
    reached, required = record.get("success"), record.get("required_success")
    if not isinstance(reached, float) or not isinstance(required, float) or reached >= required:
        return None
    return (
        f"after {record.get('timesteps')} steps the best policy succeeds in {reached:.0%} of the episodes of nominal "
        f"robots, expected at least {required:.0%}"
    )


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    """Writes the record of a run.

    Raises:
        OSError: the file cannot be written.
    """
    _files.write(folder / RECORD, json.dumps(record, indent=2) + "\n")


def add_time(folder: Path, timesteps: int, seconds: float) -> None:
    """Records when learning ended, the number of steps and the duration; a resumed run adds to the time."""
    record = _with_more(read_record(folder), "seconds", seconds)
    write_record(folder, {**record, "finished": now(), "timesteps": timesteps})


def add_fit_time(folder: Path, seconds: float) -> None:
    """Records the duration of a fit to a teacher or of its refinement, which is not in `seconds`."""
    write_record(folder, _with_more(read_record(folder), "fit_seconds", seconds))


def _with_more(record: Mapping[str, Any], name: str, seconds: float) -> dict[str, Any]:
    before = record.get(name, 0.0)
    return {**record, name: (before if isinstance(before, float) else 0.0) + seconds}


def read_evaluations(folder: Path) -> Evaluations | None:
    """The evaluations of a run; None if it has none yet.

    Raises:
        ValueError: the file is damaged.
    """
    path = folder / EVALUATIONS
    if not path.is_file():
        return None
    names = ("timesteps", "results", "ep_lengths", "successes")
    try:
        with np.load(path) as kept:
            timesteps, *others = (kept[name].astype(float) for name in names)
    except (ValueError, KeyError, TypeError, EOFError, OSError, zipfile.BadZipFile):
        # NumPy's message for a damaged file advises reading it as a pickle.
        raise ValueError(f"{path} is damaged: it must hold the arrays {', '.join(names)}") from None
    shapes = {array.shape for array in others}
    if timesteps.ndim != 1 or len(shapes) != 1 or any(len(s) != 2 or s[0] != len(timesteps) for s in shapes):
        found = ", ".join(str(array.shape) for array in (timesteps, *others))
        raise ValueError(f"{path} is damaged: its arrays have the shapes {found}")
    return Evaluations(timesteps, *others)


def read_config_text(folder: Path) -> str:
    """The text of a run's configuration.

    Raises:
        FileNotFoundError: there is no configuration.
        OSError: it cannot be read.
        ValueError: it is not text.
    """
    path = folder / CONFIG
    if not path.exists():
        raise FileNotFoundError(
            f"{folder} holds a training run without {CONFIG}: it ended before training began, or the file was deleted; "
            "begin it again with --overwrite"
        )
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is damaged: {error}") from error


def checkpoint_path(folder: Path, timesteps: int) -> Path:
    """Path of the checkpoint after this number of steps."""
    return folder / CHECKPOINTS / f"rl_model_{timesteps}_steps.zip"


def checkpoints(folder: Path) -> list[Path]:
    """The checkpoints of a run, newest first."""
    found = {path: path.stem.split("_")[-2] for path in (folder / CHECKPOINTS).glob("rl_model_*_steps.zip")}
    numbered = {path: int(steps) for path, steps in found.items() if steps.isdecimal()}
    return sorted(numbered, key=lambda path: numbered[path], reverse=True)
