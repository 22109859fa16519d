"""`ballbot train any`: one policy for several robots, from the command line to other robots."""

import json
import shutil

import pytest

import ballbot_rs as bb
from ballbot_rs import _files
from ballbot_rs._core import TASKS
from ballbot_rs._short import number
from ballbot_rs.analysis import recovery_map
from ballbot_rs.cli import main
from ballbot_rs.control import sb3_policy
from ballbot_rs.control.resolve import find
from ballbot_rs.envs.family import sample_robots
from ballbot_rs.media.report import origin
from ballbot_rs.training import config, run_folder, teacher
from ballbot_rs.training import train as train_module
from tests.support.killed_training import weights

SMALL = {
    "num_envs": 32,
    "robot.family": 4,
    "teacher.rounds": 1,
    "teacher.steps": 5,
    "teacher.epochs": 1,
    "refinement.robots": '[{"family": 1}]',
    "refinement.hardest": 1,
    "refinement.others": 0,
    "refinement.generations": 3,
    "refinement.population": 4,
    "evaluation.episodes": 8,
    "algorithm_arguments.n_steps": 4,
    "algorithm_arguments.batch_size": 64,
}


QUIET = ["--quiet", "--episodes", "0", "--no-report"]


def train(folder):
    values = [text for name, value in SMALL.items() for text in ("--set", f"{name}={value}")]
    return main(["train", "any", *QUIET, "--run", str(folder), *values])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("any") / "run"
    # It is too short to succeed.
    assert train(folder) == 1
    return folder


def test_a_fitted_refined_and_trained_policy_is_odd(run):
    model, _ = sb3_policy.load(run / run_folder.FINAL, "balance")
    first, *others = teacher._actor(model)
    rows = [row["name"] for row in TASKS["balance"]["observation"]]
    of_vertical = first.unflatten(1, (-1, len(rows)))[:, :, rows.index("gravity direction, body z")]
    assert first.any()
    assert not of_vertical.any()
    assert not any(biases.any() for biases in others if biases.ndim == 1)


def test_a_run_is_of_a_family_and_drives_other_robots(run):
    trained = config.parse((run / "config.toml").read_text(encoding="utf-8"), "config.toml")
    usual = config.parse(config.default_text("balance", "any"), "balance-any.toml").env["robot"]
    assert trained.env["robot"] == {**usual, "family": 4}
    for params in ({"family": 3, "seed": 9}, "rezero", ["paper", "kugle"]):
        found = bb.evaluate(run, episodes=24, robot=params)
        assert found.episodes == 24
    # Tools for one robot take the first.
    map_of_one = recovery_map.collect(str(run), rings=1, sectors=3, seconds=1.0, env_options={"events": None})
    assert map_of_one is not None


def test_the_fit_is_to_the_position_error_itself(tmp_path, monkeypatch):
    """The law has no integral action: with the integral in the observation its actions would be of another place."""
    rates, fit = [], teacher.fit

    def observed(model, *arguments):
        (options,) = model.get_env().get_attr("task_options", [0])
        rates.append(options["integral_rate"])
        fit(model, *arguments)

    learn = train_module._learn

    def learned(session, *arguments):
        (options,) = session.model.get_env().get_attr("task_options", [0])
        rates.append(options["integral_rate"])
        return learn(session, *arguments)

    monkeypatch.setattr(teacher, "fit", observed)
    monkeypatch.setattr(train_module, "_learn", learned)
    train(tmp_path / "run")
    usual = config.parse(config.default_text("balance", "any"), "balance-any.toml").env["integral_rate"]
    assert rates == [0.0, usual]
    assert find(str(tmp_path / "run")).env_options["integral_rate"] == usual > 0.0


def test_the_time_of_the_fit_is_recorded(run):
    record = run_folder.read_record(run)
    assert record["fit_seconds"] > 0.0
    assert dict(origin.rows(record, run, "balance"))["fit to the teacher"].startswith("in ")


def test_an_interrupted_refinement_continues_where_it_was(run, tmp_path, monkeypatch, capsys):
    folder, write = tmp_path / "run", _files.write
    record = folder / run_folder.FIT / run_folder.OBJECTIVE

    def full(path, content):
        if path == record and record.exists():
            raise OSError(28, "No space left on device")
        write(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(_files, "write", full)
        assert train(folder) == 1
    assert "No space left on device" in capsys.readouterr().err
    (first,) = json.loads(record.read_text(encoding="utf-8"))
    assert len(first) == SMALL["refinement.population"]
    record.write_text("[[1.0]]", encoding="utf-8")
    assert main(["train", "--resume", str(folder), *QUIET]) == 1
    assert f"{record} is damaged: its shape is (1, 1)" in capsys.readouterr().err
    record.write_text(json.dumps([first]), encoding="utf-8")
    main(["train", "--resume", str(folder), *QUIET])
    assert "the training has failed: after" in capsys.readouterr().err
    for name in (run_folder.FINAL, run_folder.BEST):
        assert weights(folder / name) == weights(run / name)
    assert not record.parent.exists()


def test_a_run_resumed_right_after_the_refinement_is_the_same(run, tmp_path):
    again = shutil.copytree(run, tmp_path / "run")
    for checkpoint in run_folder.checkpoints(again)[:-1]:
        checkpoint.unlink()
    main(["train", "--resume", str(again), *QUIET])
    assert weights(again / run_folder.FINAL) == weights(run / run_folder.FINAL)


@pytest.mark.slow("the maps of a report")
def test_a_report_shows_the_first_robot(run, tmp_path):
    path = tmp_path / "report.html"
    assert main(["report", str(run), "--episodes", "0", "--video-seconds", "0", "-o", str(path), "--quiet"]) == 0
    first = sample_robots(1, 0, config.parse((run / "config.toml").read_text("utf-8"), "").env["robot"]["ranges"])[0]
    assert f"<td>{number(first.body_mass)}</td>" in path.read_text(encoding="utf-8")


def test_a_policy_of_a_family_is_exported_for_a_robot(run, tmp_path, capsys):
    onnx, header = tmp_path / "any.onnx", tmp_path / "any.h"
    assert main(["export", str(run), "-o", str(onnx)]) == 0
    assert main(["export", str(onnx), "-o", str(header)]) == 1
    assert "name the robot" in capsys.readouterr().err
    assert main(["export", str(onnx), "--robot", "kugle", "-o", str(header), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["metadata"]["max_wheel_torque"] is None
    torque = bb.BalanceEnv(robot="kugle", scale_by_robot=True).max_wheel_torque
    assert f"BALLBOT_POLICY_MAX_TORQUE = {torque:.6g} N m" in header.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["any", "--config", "recover"], "'any' names a configuration of balance"),
        (["any", "--algorithm", "cma"], "evolution tries each policy on one robot"),
        (["any", "--set", "num_envs=64"], "robot has 512 robots, but num_envs = 64 has room for 8"),
        (["any", "--set", "horizon=3.0", "--set", "algorithm_arguments={}"], "horizon follows from one robot"),
        (["any", "--robot", "kugle", "--set", "robot.family=3"], "a robot is also given"),
    ],
)
def test_what_does_not_fit_several_robots_is_rejected(arguments, words, tmp_path, capsys):
    assert main(["train", *arguments, "--run", str(tmp_path / "run"), "--episodes", "0"]) == 1
    assert words in capsys.readouterr().err
