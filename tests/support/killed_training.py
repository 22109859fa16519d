"""Trains in processes that are killed, resumes each run, and checks that nothing was lost.

Usage: python -m tests.support.killed_training FOLDER RANDOM_KILLS

Prints a line per kill. The kills are aimed at a moment of writing a file, or come at random times.
"""

import importlib
import os
import random
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from ballbot_rs.control import sb3_archive, sb3_policy
from ballbot_rs.training import config, run_folder, train
from tests.support.tiny_config import TINY_CONFIG

STEPS = 768
#: (moment, beginning of the file's name, index of the occurrence)
AIMED = [
    *(
        ("half written", "rl_model_256", 1),
        ("before the move", "rl_model_256", 1),
        ("after the move", "rl_model_256", 1),
    ),
    *(("half written", "rl_model_512", 1), ("before the move", "rl_model_512", 1)),
    *(("half written", "best_model", 1), ("before the move", "best_model", 1), ("after the move", "best_model", 1)),
    *(("half written", "evaluations", 1), ("before the move", "evaluations", 2), ("after the move", "evaluations", 2)),
    *(("half written", "final_model", 1), ("half written", "run", 1), ("half written", "config", 1)),
]


def main(folder: Path, random_kills: int) -> int:
    """Returns 0 if every run continued correctly."""
    torch.set_num_threads(1)
    # Imported by the first training; once here instead of in every process.
    for name in ("torch._dynamo", "torch.utils.tensorboard"):
        importlib.import_module(name)
    problems = 0
    started = time.monotonic()
    whole = in_child(lambda: trained(folder / "whole"))
    seconds = time.monotonic() - started
    assert whole == 0, "a training that nobody kills fails"
    first = (folder / "whole" / "run.json").stat().st_mtime
    learning = (folder / "whole" / "final_model.zip").stat().st_mtime - first
    for i, (moment, name, count) in enumerate(AIMED):
        run = folder / f"aimed-{i}"
        ended = in_child(lambda run=run, aim=(moment, name, count): (aim_at(*aim), trained(run)))
        problems += report(f"{moment}: {name} {count}", ended, run, folder / "whole")
    rng = random.Random(0)
    for i in range(random_kills):
        run, after = folder / f"random-{i}", rng.uniform(seconds - learning, seconds)
        ended = in_child(lambda run=run: trained(run), kill_after=after)
        # A process may finish before its kill.
        problems += report(f"after {after:.2f} s", ended if ended else -signal.SIGKILL, run, folder / "whole")
    return int(problems > 0)


def trained(run: Path) -> None:
    """Trains to the end."""
    train.train(config.parse(TINY_CONFIG, "tiny"), TINY_CONFIG, run, seed=5, progress_bar=False)


def aim_at(moment: str, name: str, count: int) -> None:
    """Arranges that this process is killed at a moment of writing a file."""
    write, move, happened = Path.write_bytes, Path.replace, [0]

    def is_time(path: Path) -> bool:
        happened[0] += path.name.startswith(f".{name}")
        return happened[0] == count and path.name.startswith(f".{name}")

    def die() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def killed_write(path: Path, content: bytes) -> int:
        if is_time(path):
            write(path, content[: len(content) // 2])
            die()
        return write(path, content)

    def killed_move(path: Path, target: Path) -> Path:
        is_now = is_time(path)
        if is_now and moment == "before the move":
            die()
        moved = move(path, target)
        if is_now:
            die()
        return moved

    if moment == "half written":
        Path.write_bytes = killed_write
    else:
        Path.replace = killed_move


def report(kill: str, ended: int, run: Path, whole: Path) -> int:
    """Resumes a killed run in a separate process; 0 if all is well."""
    before = [path.name for path in run_folder.checkpoints(run)]
    resumed = in_child(lambda: check(run, whole)) if ended == -signal.SIGKILL else 1
    text = "well" if resumed == 0 else f"LOST (training ended with {ended}, resuming with {resumed})"
    print(f"killed {kill}: {len(before)} checkpoints, {text}", flush=True)
    return int(resumed != 0)


def check(run: Path, whole: Path) -> None:
    """Resumes a run; an AssertionError reports what is missing, or differs from the uninterrupted run."""
    kept = run_folder.checkpoints(run)
    for path in kept:
        sb3_archive.read(path)
    if not kept:
        # Nothing has been learned yet.
        try:
            train.resume(run, progress_bar=False)
        except FileNotFoundError:
            shutil.rmtree(run, ignore_errors=True)
            trained(run)
        else:
            raise AssertionError("a run without a checkpoint was resumed")
    else:
        output: list[str] = []
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            train.resume(run, progress_bar=False, tell=output.append)
        assert output == [f"resuming from {kept[0]}"], output
    evaluations = run_folder.read_evaluations(run)
    assert evaluations is not None
    assert evaluations.timesteps.tolist() == [256, 512, STEPS], evaluations.timesteps
    best, _ = sb3_policy.load(run / run_folder.BEST, "balance")
    assert best.num_timesteps == evaluations.timesteps[evaluations.returns.mean(axis=1).argmax()], "not the best one"
    final, _ = sb3_policy.load(run / run_folder.FINAL, "balance")
    assert final.num_timesteps == STEPS
    for name in (run_folder.BEST, run_folder.FINAL):
        assert weights(run / name) == weights(whole / name), f"{name} has other bits than without the kill"
    uninterrupted = run_folder.read_evaluations(whole)
    assert uninterrupted is not None
    assert np.array_equal(evaluations.returns, uninterrupted.returns)
    assert not list(run.rglob(".*partial*")), "an unfinished file is left"
    assert np.isfinite(evaluations.returns).all()


def weights(file: Path) -> list[bytes]:
    """Weights, moments and counts of a policy and its optimizer."""
    parameters = sb3_policy.load(file, "balance")[0].get_parameters()
    tensors = list(parameters["policy"].values())
    for state in parameters["policy.optimizer"]["state"].values():
        tensors += state.values()
    return [tensor.numpy().tobytes() for tensor in tensors]


def in_child(work: Callable[[], object], kill_after: float | None = None) -> int:
    """The exit code of a child process that calls this; negative for the signal that killed it."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2])))
