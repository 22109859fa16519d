"""`ballbot train any`: one policy for several robots, from the command line to other robots."""

import json

import pytest

import ballbot_rs as bb
from ballbot_rs._short import number
from ballbot_rs.analysis import recovery_map
from ballbot_rs.cli import main
from ballbot_rs.envs.family import sample_robots
from ballbot_rs.training import config

SMALL = {
    "num_envs": 32,
    "robot.family": 4,
    "teacher.rounds": 1,
    "teacher.steps": 5,
    "teacher.epochs": 1,
    "refinement.robots": '[{"family": 1}]',
    "refinement.hardest": 1,
    "refinement.others": 0,
    "refinement.generations": 1,
    "refinement.population": 4,
    "evaluation.episodes": 8,
    "algorithm_arguments.n_steps": 4,
    "algorithm_arguments.batch_size": 64,
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("any") / "run"
    values = [text for name, value in SMALL.items() for text in ("--set", f"{name}={value}")]
    # It is too short to succeed.
    assert main(["train", "any", "--quiet", "--episodes", "0", "--no-report", "--run", str(folder), *values]) == 1
    return folder


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
