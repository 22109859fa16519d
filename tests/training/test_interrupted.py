"""Trainings that are killed, interrupted or run out of disk: nothing is lost, and what is damaged is named."""

import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from stable_baselines3 import PPO

from ballbot_rs.cli import main
from ballbot_rs.training import config, run_folder, train
from tests.support import commands
from tests.support.killed_training import weights
from tests.support.paths import ROOT
from tests.support.tiny_config import TINY_CONFIG


@pytest.fixture
def longer_run(tiny_run, tmp_path):
    """A finished run that is to have 1024 steps from now on."""
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (run / "config.toml").write_text(config.with_values(TINY_CONFIG, {"total_timesteps": 1024}), encoding="utf-8")
    return run


def ended_process():
    """The number of a process that runs no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def contents(run):
    return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and "events" not in path.name}


@pytest.mark.slow("a process per kill")
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs fork and SIGKILL")
def test_twenty_kills_lose_nothing(tmp_path):
    command = [sys.executable, "-m", "tests.support.killed_training", str(tmp_path), "6"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300, check=False)
    lines = done.stdout.splitlines()
    assert len(lines) == 20, done.stderr
    assert [line for line in lines if not line.endswith("well")] == [], done.stderr
    assert done.returncode == 0, done.stderr


def test_a_damaged_checkpoint_is_skipped_and_later_evaluations_are_dropped(longer_run, capsys):
    newest, second, _ = run_folder.checkpoints(longer_run)
    newest.write_bytes(newest.read_bytes()[:5000])
    (longer_run / f".best_model.{ended_process()}.partial.zip").write_bytes(b"x")
    code = main(["train", "--resume", str(longer_run), "--quiet", "--episodes", "0", "--no-report"])
    err = capsys.readouterr().err.splitlines()
    assert code == 0
    assert len(err) == 2
    assert err[0].startswith(f"ballbot: warning: skipped a checkpoint: {newest} is not a policy file")
    assert err[1] == f"resuming from {second}"
    assert np.load(longer_run / "evaluations.npz")["timesteps"].tolist() == [256, 512, 768, 1024]
    assert PPO.load(longer_run / "final_model.zip").num_timesteps == 1024
    assert not list(longer_run.rglob(".*partial*"))


def test_leftovers_of_a_kill_do_not_prevent_resuming(tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    dead, alive = (run / f".run.{process}.partial.json" for process in (ended_process(), os.getppid()))
    dead.write_text("{")
    resume = ["train", "--resume", str(run), "--quiet"]
    assert main(resume) == 1
    assert capsys.readouterr().err == f"ballbot: {run} holds no training run: there is no run.json in it\n"
    train.train(config.parse(TINY_CONFIG, "tiny"), TINY_CONFIG, run, seed=5, progress_bar=False)
    assert not dead.exists()
    alive.write_text("{")
    dead.write_text("{")
    shutil.rmtree(run / "checkpoints")
    assert main(resume) == 1
    assert "has no checkpoint to resume from: the run ended too early" in capsys.readouterr().err
    assert (dead.exists(), alive.exists()) == (False, True), "only files of dead processes are deleted"
    (run / "config.toml").unlink()
    assert main(resume) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"ballbot: {run} holds a training run without config.toml: ")
    assert "begin it again with --overwrite" in err


def test_a_best_policy_from_after_the_checkpoint_stays(longer_run):
    evaluations = dict(np.load(longer_run / "evaluations.npz"))
    evaluations["results"][2] = 1e6
    np.savez(longer_run / "evaluations.npz", **evaluations)
    newest = run_folder.checkpoints(longer_run)[0]
    shutil.copy(newest, longer_run / "best_model.zip")
    best = newest.read_bytes()
    newest.unlink()
    train.resume(longer_run, progress_bar=False)
    assert (longer_run / "best_model.zip").read_bytes() == best
    assert run_folder.read_evaluations(longer_run).timesteps.tolist() == [256, 512, 768, 1024]


DAMAGES = {
    "evaluations.npz": (lambda content: content[: len(content) // 2], "is damaged: it must hold the arrays timesteps"),
    "best_model.zip": (lambda content: content[: len(content) // 2], "is not a policy file of Stable-Baselines3"),
    "run.json": (lambda content: content[: len(content) // 2], "is damaged: "),
    "config.toml": (lambda _: b"", "it is empty"),
}


@pytest.mark.parametrize("name", DAMAGES)
@pytest.mark.parametrize("how", ["damaged", "empty", "bytes"])
def test_a_damaged_file_is_named(longer_run, capsys, name, how):
    damage, message = DAMAGES[name]
    path = longer_run / name
    content = {"damaged": damage(path.read_bytes()), "empty": b"", "bytes": b"\xff\x00\xfe" * 50}[how]
    path.write_bytes(content)
    before = contents(longer_run)
    for arguments in (["train", "--resume", longer_run, "--quiet"], ["report", longer_run, "--quiet"]):
        if name == "config.toml" and arguments[0] == "report" and how != "bytes":
            continue
        code = main(list(map(str, arguments)))
        out, err = capsys.readouterr()
        assert code == 1
        assert out == ""
        assert err.startswith(f"ballbot: {path}")
        assert err.count("\n") == 1
        assert how != "damaged" or message in err
        assert contents(longer_run) == before


def test_without_a_readable_checkpoint(longer_run):
    for path in run_folder.checkpoints(longer_run):
        path.write_bytes(b"")
    with (
        pytest.warns(UserWarning, match="skipped a checkpoint") as caught,
        pytest.raises(ValueError, match=r"none of the 3 checkpoints in .* can be read"),
    ):
        train.resume(longer_run, progress_bar=False)
    assert len(caught) == 3


@pytest.mark.slow("processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_saves_and_prints_how_to_resume(tmp_path, number):
    path = tmp_path / "tiny.toml"
    text = TINY_CONFIG.replace("768", "100_000_000").replace('[schedule]\nlearning_rate = "linear"\n', "")
    path.write_text(text, encoding="utf-8")
    run = tmp_path / "run"
    process = commands.start("train", "--config", path, "--run", run, "--quiet")
    commands.wait_for(run / "evaluations.npz", process)
    process.send_signal(number)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, out) == (128 + number, "")
    newest = run_folder.checkpoints(run)[0]
    message, ended = err.splitlines()
    assert message == f"saved {newest}, to continue: ballbot train balance --resume {run}"
    assert ended == {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    steps = PPO.load(newest).num_timesteps
    # A constant rate: the number of steps has no other effect.
    train.resume(run, timesteps=steps + 256, progress_bar=False)
    assert PPO.load(run / "final_model.zip").num_timesteps == steps + 256
    text = config.with_values(text, {"total_timesteps": steps + 256})
    whole = tmp_path / "whole"
    train.train(config.parse(text, "tiny"), text, whole, progress_bar=False)
    assert weights(run / "final_model.zip") == weights(whole / "final_model.zip")


@pytest.mark.slow("processes")
def test_a_full_disk_leaves_what_was_there(longer_run):
    pytest.importorskip("resource")
    before = contents(longer_run)
    done = commands.run("train", "--resume", longer_run, "--quiet", largest_file=10_000)
    checkpoint = run_folder.checkpoint_path(longer_run, 1024)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"ballbot: {checkpoint}: not written: File too large"
    assert "Traceback" not in done.stderr
    assert contents(longer_run) == before
    train.resume(longer_run, progress_bar=False)
    assert PPO.load(longer_run / "final_model.zip").num_timesteps == 1024
