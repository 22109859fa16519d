"""Continuing from a checkpoint: its weights and counters are read, nothing in it is unpickled."""

import warnings
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs.control import sb3_archive
from ballbot_rs.training import run_folder

#: Contents of a checkpoint in addition to the weights and the state of the optimizer.
COUNTERS = ("num_timesteps", "_episode_num", "_n_updates")


def restore_newest(model: BaseAlgorithm, folder: Path) -> Path:
    """Gives a new model the state of a run's newest readable checkpoint; returns the checkpoint.

    A `UserWarning` names each skipped checkpoint, and the reason.

    Raises:
        FileNotFoundError: there is no checkpoint.
        ValueError: none can be read.
    """
    found = run_folder.checkpoints(folder)
    if not found:
        raise FileNotFoundError(
            f"{folder} has no checkpoint to resume from: the run ended too early; begin it again with --overwrite"
        )
    for path in found:
        problem = _restore(model, path)
        if problem is None:
            return path
        warnings.warn(f"skipped a checkpoint: {problem}", UserWarning, stacklevel=2)
    raise ValueError(f"none of the {len(found)} checkpoints in {found[0].parent} can be read")


def _restore(model: BaseAlgorithm, path: Path) -> str | None:
    """Gives the model the state of a checkpoint, or returns why it cannot."""
    try:
        data = sb3_archive.read(path)
    except (ValueError, OSError) as error:
        return str(error)
    counters = {name: data.get(name) for name in COUNTERS}
    for name, value in counters.items():
        if not isinstance(value, int) or value < 0:
            return f"{path} is damaged: {name} = {value!r} must be a whole number of at least 0"
    try:
        model.set_parameters(str(path), exact_match=True, device="cpu")
    # The exceptions of weights that do not fit have no common base class.
    except Exception as error:
        return f"{path} does not fit the run's configuration: {error}"
    for name, value in counters.items():
        setattr(model, name, value)
    return None
