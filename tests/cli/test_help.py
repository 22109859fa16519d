"""The help of every command, and its examples."""

import argparse
import shlex
from pathlib import Path

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.cli import EXAMPLES, parser
from ballbot_rs.cli import main as ballbot
from tests.support.in_process import run
from tests.support.paths import ASSETS

(COMMANDS,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
ALL = [line for command in COMMANDS.choices.values() for line, _ in command.examples] + [line for line, _ in EXAMPLES]

#: Examples that take less than 2 s each, after `log.csv` and `mine.toml` are there.
CHEAP = (
    "list",
    "list controllers",
    "list policies --json",
    "info --json",
    "compare --list",
    "export assets/policies/balance.onnx -o policy.h",
    "export --controller lqr --controller-option position=0.1 --robot kugle -o gains.h",
    "export --estimator --robot kugle --sensors kugle -o estimator.h",
    "simulate --controller lqi --seconds 10 -o run.csv",
    "simulate --controller lqr --tilt 5deg,0 --push 0.3,0,0 --push-at 500ms -o push.npz",
    "simulate --controller lqr --reference position=[0.5,0] --robot kugle --json",
    "evaluate --controller lqr --controller pid --episodes 20",
    "evaluate --controller-option position=0.02 --robot kugle --actuators kugle --episodes 20",
    "record --controller lqr --tilt 5deg,0 --seconds 1 --no-video --still 0.2 --schematic",
    "record-log --robot kugle --actuators kugle --seconds 2 --pose -o log.npz",
)


@pytest.mark.parametrize("name", COMMANDS.choices)
def test_the_help_has_a_sentence_a_short_usage_and_examples(capsys, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "100")
    code, out, _ = run(capsys, name, "--help")
    assert code == 0
    usage, empty, sentence = out.splitlines()[:3]
    assert usage.startswith(f"usage: ballbot {name} [OPTIONS]")
    assert empty == ""
    assert sentence[0].isupper()
    examples = out.partition("\nexamples:\n")[2]
    assert examples.count(f"  ballbot {name}") >= 2
    assert all(len(line) <= 100 for line in out.splitlines())


@pytest.mark.parametrize("line", ALL)
def test_an_example_is_a_command_line(line):
    assert callable(parser().parse_args(shlex.split(line)).carry_out)


@pytest.mark.parametrize("line", CHEAP)
def test_a_cheap_example_runs(capsys, tmp_path, monkeypatch, line):
    assert line in ALL
    monkeypatch.chdir(tmp_path)
    (tmp_path / "assets").symlink_to(ASSETS)
    arguments = shlex.split(line)
    code, out, err = run(capsys, *arguments)
    assert (code, err) == (0, "")
    if "-o" in arguments:
        assert (tmp_path / arguments[arguments.index("-o") + 1]).stat().st_size > 0
    else:
        assert out


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("train --algo SAC", "--set algorithm=SAC"),
        ("train --algo foo", "invalid choice: 'foo', expected cma, or --set algorithm= with PPO or SAC"),
        ("train --learning-rate 1e-4", "did you mean '--set algorithm_arguments.learning_rate=VALUE'?"),
        ("evaluate --control-dt 0.02", "did you mean '--set control_dt=VALUE'?"),
        ("evaluate --body-mass 2", "did you mean '--set robot.body_mass=VALUE'?"),
        ("evaluate --conroller lqr", "did you mean '--controller'?"),
        ("record --controler lqr", "did you mean '--controller'?"),
    ],
)
def test_an_unknown_option_is_answered_by_the_nearest_name_in_the_last_line(capsys, line, message):
    code, out, err = run(capsys, *shlex.split(line))
    assert (code, out) == (2, "")
    usage, last = err.splitlines()
    command = line.split()[0]
    assert usage.startswith(f"usage: ballbot {command} [OPTIONS]")
    assert last.startswith(f"ballbot {command}: ")
    assert message in last


def test_a_key_of_a_table_of_the_configuration_is_named_in_full(capsys):
    _, _, err = run(capsys, "train", "--set", "learning_rate=1e-4")
    assert "unknown option 'learning_rate': did you mean 'algorithm_arguments.learning_rate'?" in err


def test_the_origin_of_an_error_is_red_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert ballbot(["evaluate", "--robot", "kugel"]) == 1
    assert capsys.readouterr().err.startswith("\x1b[1;31mballbot:\x1b[0m unknown robot 'kugel'")
    monkeypatch.setenv("NO_COLOR", "1")
    assert ballbot(["evaluate", "--robot", "kugel"]) == 1
    assert capsys.readouterr().err.startswith("ballbot: unknown robot 'kugel'")


OPTION = ("--controller-option", "position=0.02")


def test_a_controller_has_its_options_in_every_command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    law = bb.make_controller("lqr", position=0.02)
    expected = bb.evaluate(law, episodes=3)
    code, out, _ = run(capsys, "evaluate", *OPTION, "--episodes", 3, "--json", "--seed", 1000)
    assert code == 0
    assert f'"ball_rms": {expected.ball_rms}' in out
    assert '"controller": "lqr (position=0.02)"' in out
    assert run(capsys, "simulate", *OPTION, "--seconds", 1, "-o", "run.npz")[0] == 0
    with np.load("run.npz") as written:
        torques = bb.simulate(law, seconds=1.0, tilt=(0.08, 0.05)).torques
        assert written["wheel_torque_0_N_m"] == pytest.approx(torques[:, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("posit=1",), "lqr has no option 'posit': did you mean 'position'?"),
        (("lqi.position=1",), "lqi is not one of the controllers lqr"),
        (("position=-1",), "position = -1 is out of range: it must be >= 1e-6 and <= 1e6 m"),
        (("position=1", "--controller", "zero"), "zero has none: options exist for the controllers of the package"),
    ],
)
def test_an_option_that_no_controller_has_is_an_error(capsys, arguments, message):
    code, _, err = run(capsys, "evaluate", "--episodes", 1, "--controller-option", *arguments)
    assert code == 1
    assert message in err


def test_one_of_several_controllers_has_an_option(capsys):
    several = ("--controller", "lqr", "--controller", "lqi", "--controller-option", "lqi.position=0.1")
    code, out, err = run(capsys, "evaluate", "--episodes", 1, *several, "--json")
    assert (code, err) == (0, "")
    assert '"controller": "lqr"' in out
    assert '"controller": "lqi (position=0.1)"' in out


MOTORS = "\n[actuators]\ndelay = 0.04\n"


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(bb.Params.paper().to_toml() + MOTORS, encoding="utf-8")
    return "mine.toml"


def test_the_motors_of_a_robots_file_apply_in_every_command(capsys, robot):
    def evaluated(*arguments):
        code, out, err = run(capsys, "evaluate", "--episodes", 2, "--json", "--robot", robot, *arguments)
        assert (code, err) == (0, "")
        return out

    own = evaluated()
    assert own == evaluated("--actuators", robot)
    assert own != evaluated("--actuators", "ideal")

    def logged(*arguments):
        assert run(capsys, "record-log", "--robot", robot, "--seconds", 0.5, *arguments)[0] == 0
        return Path("log.csv").read_text(encoding="utf-8")

    own = logged()
    assert own == logged("--actuators", robot)
    assert own != logged("--actuators", "ideal")


def test_a_header_in_c_takes_from_a_robots_file_what_it_depends_on(capsys, robot):
    assert run(capsys, "export", "--controller", "lqr", "--robot", robot, "-o", "a.h")[0] == 0
    _, _, err = run(capsys, "export", "--controller", "lqr", "--robot", robot, "--actuators", robot, "-o", "a.h")
    assert "does not depend on actuators" in err


def test_the_policies_of_the_package_have_different_texts():
    from ballbot_rs.cli.commands.list_names import policies

    found = policies()
    assert len(found) >= 7
    assert len(set(found.values())) == len(found)
