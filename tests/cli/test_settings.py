"""`--set`: parts of options, and what they are laid over."""

import pytest

from ballbot_rs import Params, _toml
from tests.support.in_process import parse_json, run


def test_parts_of_options_override_what_other_arguments_name(capsys, tmp_path):
    motors = tmp_path / "motors.toml"
    motors.write_text("[actuators]\ndelay = 0.02\nlag = 0.01\n")
    how = ("--model", "spatial", "--episodes", 2, "--json")
    results = []
    for given in (
        ("--actuators", motors, "--set", "actuators.delay=0.004"),
        ("--set", 'actuators={"delay": 0.02, "lag": 0.01}', "--set", "actuators.delay=0.004"),
        ("--set", "actuators.lag=0.01", "--set", "actuators.delay=0.004"),
        ("--actuators", motors),
    ):
        code, out, err = run(capsys, "evaluate", *given, *how)
        assert (code, err) == (0, "")
        results.append(parse_json(out)["results"])
    assert results[0] == results[1] == results[2] != results[3]


def test_parts_of_options_override_the_options_of_a_policy(capsys, tmp_path, tiny_config):
    how = ("--run", tmp_path / "run", "--quiet", "--episodes", 0, "--no-report")
    trained = ("--robot", "kugle", "--set", "actuators.lag=0.01")
    assert run(capsys, "train", "--config", tiny_config, *trained, *how)[0] == 0
    controllers = ("--controller", tmp_path / "run", "--controller", "lqr")
    given = ("--set", "robot.body_mass=15", "--set", "actuators.delay=0.004")
    code, out, _ = run(capsys, "evaluate", *controllers, "--episodes", 1, *given)
    assert code == 0
    conditions = " ".join(out.split())
    for text in ("robot kugle with body_mass = 15", "lag = 0.01", "delay = 0.004"):
        assert text in conditions


def test_parts_of_the_command_line_override_the_configuration(capsys, tmp_path, tiny_config):
    from ballbot_rs.training import config

    text = tiny_config.read_text(encoding="utf-8")
    assert "[env]" in text
    tiny_config.write_text(text.replace("[env]", '[env]\nrobot = "kugle"\nreward = { tilt = 2.0 }'), encoding="utf-8")
    how = ("--run", tmp_path / "run", "--quiet", "--episodes", 0, "--no-report")
    given = ("--set", "robot.body_mass=15", "--set", "reward.position=2", "--set", "evaluation.episodes=1")
    assert run(capsys, "train", "--config", tiny_config, *given, *how)[0] == 0
    kept, _ = config.load("balance", tmp_path / "run" / "config.toml")
    assert Params(**kept.env["robot"]) == Params.preset("kugle").replace(body_mass=15)
    assert kept.env["reward"] == {"tilt": 2.0, "position": 2}
    assert kept.evaluation.episodes == 1


def test_values_of_the_command_line_override_the_configuration(capsys, tmp_path, tiny_config):
    robot = tmp_path / "mine.toml"
    robot.write_text(_toml.dumps(Params.preset("kugle").to_dict()), encoding="utf-8")
    changes = ["--model", "planar", "--set", "algorithm_arguments.gamma=0.9", "--set", "total_timesteps=256"]
    changes += ["--robot", robot]
    how = ["--run", tmp_path / "run", "--quiet", "--episodes", 0, "--no-report"]
    assert run(capsys, "train", "--config", tiny_config, *changes, *how)[0] == 0
    from ballbot_rs.training import config

    kept, _ = config.load("balance", tmp_path / "run" / "config.toml")
    assert kept.env["model"] == "planar"
    assert kept.algorithm_arguments["gamma"] == 0.9
    assert kept.total_timesteps == 256
    assert kept.policy == {"net_arch": [8]}
    assert Params(**kept.env["robot"]) == Params.preset("kugle")
    code, out, _ = run(capsys, "evaluate", "--controller", tmp_path / "run", "--episodes", 1, "--json")
    assert code == 0
    assert parse_json(out)["results"][0]["model"] == "planar"


def test_instruments_have_parts(capsys):
    code, _, err = run(capsys, "evaluate", "--episodes", 1, "--set", "scan.points=[3, 3]", "--set", "lidar.beams=5")
    assert (code, err) == (0, "")
    code, _, err = run(capsys, "evaluate", "--episodes", 1, "--set", "scan.point=[3, 3]")
    assert code == 1
    assert "did you mean 'points'?" in err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("robot.body_mass=nan", "body_mass = NaN is out of range"),
        ("robot.body_mass=-inf", "body_mass = -inf is out of range"),
        ("control_dt=nan", "control_dt = NaN is out of range"),
        ("reward.position=inf", "reward.position = inf is out of range"),
        ("robot.body_mass=heavy", "body_mass must be an array of numbers, not str"),
    ],
)
def test_values_that_are_not_finite_are_named(capsys, given, message):
    code, _, err = run(capsys, "evaluate", "--controller", "lqr", "--episodes", 1, "--set", given)
    assert code == 1
    assert message in err
