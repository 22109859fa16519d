"""`ballbot tune`: searches of hyperparameters continue, share their work, and reject different settings."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("optuna", reason="the search is not tested: install 'ballbot-rs[tune]'")

from ballbot_rs import cli
from ballbot_rs.training import config as config_module
from ballbot_rs.training import run_folder
from ballbot_rs.training.search import BEST, Search, dimension_of, ended

TINY = """
env_id = "ballbot/Balance-v0"
algorithm = "PPO"
total_timesteps = 2048
num_envs = 16
num_threads = 1

[env]
max_episode_steps = 100

[evaluation]
every_timesteps = 1024
episodes = 4

[algorithm_arguments]
n_steps = 32
batch_size = 256
n_epochs = 1
"""

RATE = "algorithm_arguments.learning_rate"


def search(folder, trials=2, text=TINY, **space):
    given = {name.replace("__", "."): one for name, one in space.items()} or {RATE: "1e-4:1e-3:log"}
    return Search(text, {name: dimension_of(name, one) for name, one in given.items()}, folder, trials)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("1:10", (1, 10)),
        ("1e-5:1e-2:log", (1e-5, 1e-2)),
        ("-3.0:0.0", (-3.0, 0.0)),
        ("[16, 32]", (16, 32)),
        ('["a"]', ("a",)),
    ],
)
def test_a_range_is_read_as_it_is_written(text, ends):
    found = dimension_of("x", text)
    assert found.ends == ends
    assert [type(end) for end in found.ends] == [type(end) for end in ends]


@pytest.mark.parametrize("text", ["", "1", "a:b", "2:1", "0:1:log", "nan:1", "1:inf", "[]", "[[1]]", "1:2:exp", "{}"])
def test_an_invalid_range_is_rejected(text):
    with pytest.raises(ValueError, match="x="):
        dimension_of("x", text)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("env.reward.alive", "not be comparable"),
        ("reward_scale", "not be comparable"),
        ("gamma", "unknown key 'gamma'"),
        ("num_envs", r"num_envs = -3 is out of range"),
    ],
)
def test_invalid_searches_are_rejected_before_anything_is_written(tmp_path, name, message):
    with pytest.raises(ValueError, match=message):
        search(tmp_path / "study", **{name: "[-3, 4]"})
    assert not (tmp_path / "study").exists()


def test_a_search_resumes_and_its_best_configuration_comes_from_its_best_trial(tmp_path):
    search(tmp_path).work()
    found = search(tmp_path, trials=4)
    found.work()
    done = found.finish()
    assert len(ended(found.study())) == 4
    best = config_module.parse((tmp_path / BEST).read_text(), BEST)
    assert best.algorithm_arguments["learning_rate"] == done[0].params[RATE]
    for trial in done:
        folder = tmp_path / trial.user_attrs["folder"]
        returns = run_folder.read_evaluations(folder).returns
        assert trial.value == pytest.approx(returns.mean(axis=1).max())
        assert not (folder / run_folder.CHECKPOINTS).exists()
    assert len({trial.params[RATE] for trial in done}) == len(done)


def test_a_folder_has_one_search(tmp_path):
    search(tmp_path, trials=1).work()
    with pytest.raises(ValueError, match="another configuration"):
        search(tmp_path, text=TINY.replace("2048", "4096")).work()
    with pytest.raises(ValueError, match="another space"):
        search(tmp_path, **{RATE: "1e-5:1e-3:log"}).work()


def test_a_configuration_that_the_learner_rejects_ends_the_search(tmp_path):
    with pytest.raises(ValueError, match="does not fit PPO"):
        search(tmp_path, algorithm_arguments__nonsense="[1, 2]").work()


def test_numbers_with_which_the_learner_fails_end_one_trial(tmp_path):
    found = search(tmp_path, trials=2, algorithm_arguments__learning_rate="[1e30]")
    messages = []
    found.work(messages.append)
    assert len(ended(found.study())) == 2
    assert all("trial" in text for text in messages)


@pytest.mark.slow("processes")
def test_two_processes_share_the_trials_of_a_command(tmp_path, capsys):
    config = tmp_path / "tiny.toml"
    config.write_text(TINY)
    arguments = ["tune", "balance", "--config", str(config), "--study", str(tmp_path / "study"), "--trials", "3"]
    cli.main([*arguments, "--jobs", "2", "--search", f"{RATE}=1e-4:1e-3:log", "--json", "--quiet"])
    printed = json.loads(capsys.readouterr().out)
    assert len(printed["trials"]) >= 3
    rates = [trial["values"][RATE] for trial in printed["trials"]]
    assert len(set(rates)) == len(rates)
    returns = [trial["return"] for trial in printed["trials"]]
    assert returns == sorted(returns, reverse=True)
    assert np.isfinite(returns).all()


@pytest.mark.slow("processes")
@pytest.mark.skipif(sys.platform == "win32", reason="signals are specific to Unix")
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGKILL])
def test_a_search_interrupted_in_a_trial_resumes(tmp_path, kind):
    config = tmp_path / "long.toml"
    config.write_text(TINY.replace("total_timesteps = 2048", "total_timesteps = 200000000"))
    study = tmp_path / "study"
    command = [sys.executable, "-m", "ballbot_rs.cli", "tune", "balance", "--config", str(config)]
    command += ["--study", str(study), "--search", f"{RATE}=1e-4:1e-3:log", "--trials", "1"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    begins = time.monotonic()
    while not (study / "trial-0000" / "evaluations.npz").exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() - begins < 120.0
        time.sleep(0.1)
    process.send_signal(kind)
    _, output = process.communicate(timeout=60.0)
    assert process.returncode == (130 if kind == signal.SIGINT else -signal.SIGKILL), output
    text = config.read_text()
    again = Search(text, {RATE: dimension_of(RATE, "1e-4:1e-3:log")}, study, 1)
    assert len(ended(again.study())) == 0
    assert kind == signal.SIGKILL or "give the same command again" in output


@pytest.mark.slow("processes")
@pytest.mark.skipif(sys.platform == "win32", reason="signals are specific to Unix")
def test_control_c_in_a_terminal_is_reported_once_for_all_processes(tmp_path):
    config = tmp_path / "long.toml"
    config.write_text(TINY.replace("total_timesteps = 2048", "total_timesteps = 200000000"))
    command = [sys.executable, "-m", "ballbot_rs.cli", "tune", "balance", "--config", str(config), "--jobs", "2"]
    command += ["--study", str(tmp_path / "study"), "--search", f"{RATE}=1e-4:1e-3:log", "--trials", "2"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    begins = time.monotonic()
    while not all((tmp_path / "study" / f"trial-000{i}" / "evaluations.npz").exists() for i in range(2)):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() - begins < 120.0
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, output = process.communicate(timeout=60.0)
    assert process.returncode == 130, output
    assert output.count("interrupted") == 1, output
    assert "terminated" not in output
    assert "Traceback" not in output


def test_an_incomplete_line_is_removed(tmp_path):
    search(tmp_path, trials=1).work()
    journal = tmp_path / "journal.log"
    whole = journal.read_bytes()
    with journal.open("ab") as file:
        file.write(b'{"op_code": 4, "wor')
    again = search(tmp_path, trials=2)
    again.work()
    assert len(ended(again.study())) == 2
    assert journal.read_bytes().startswith(whole)


@pytest.mark.slow("processes")
def test_the_lock_of_a_killed_process_is_released(tmp_path):
    search(tmp_path).study()
    (tmp_path / "journal.log.lock").touch()
    began = time.monotonic()
    assert ended(search(tmp_path).study()) == []
    assert time.monotonic() - began < 30.0


def test_files_in_the_way_are_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="file is a file: name a folder with --study"):
        search(tmp_path / "file").study()
    (tmp_path / "garbage").mkdir()
    (tmp_path / "garbage" / "journal.log").write_text("nonsense\n")
    with pytest.raises(ValueError, match=r"journal\.log is not a search's journal .*--study"):
        search(tmp_path / "garbage").study()
    (tmp_path / "other" / "trial-0000").mkdir(parents=True)
    with pytest.raises(FileExistsError, match=r"trial-0000 is in the way of trial 0.*--study"):
        search(tmp_path / "other").work()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("algorithm_arguments.gamma", "0.5:7.5", "gamma = 7.5 is out of range: it must be from 0 to 1"),
        ("algorithm_arguments.n_epochs", "0:3", "n_epochs = 0 is out of range: it must be a whole number"),
        ("algorithm_arguments.batch_size", "[NaN, 1]", r"batch_size=\[NaN, 1\]: expected"),
    ],
)
def test_a_range_beyond_the_limits_of_the_learner_is_rejected(tmp_path, name, text, message):
    with pytest.raises(ValueError, match=message):
        Search(TINY, {name: dimension_of(name, text)}, tmp_path, 1)


@pytest.mark.slow("processes")
def test_processes_end_with_a_command_that_is_killed(tmp_path):
    arguments = [
        "tune",
        "balance",
        "--study",
        str(tmp_path / "s"),
        "--trials",
        "50",
        "--jobs",
        "2",
        "--timesteps",
        "400000",
    ]
    command = subprocess.Popen([sys.executable, "-m", "ballbot_rs.cli", *arguments])
    try:
        deadline = time.monotonic() + 60.0
        while not list((tmp_path / "s").glob("trial-*")) and time.monotonic() < deadline:
            time.sleep(0.2)
        workers = workers_of(command.pid)
        assert workers
    finally:
        command.kill()
        command.wait()
    deadline = time.monotonic() + 20.0
    while any(is_running(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not [pid for pid in workers if is_running(pid)]


def workers_of(parent):
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(pid) for pid in children]


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
