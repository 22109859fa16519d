"""`ballbot record-log` and `ballbot identify`."""

import json
import signal
import time

import pytest

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.cli.options.arguments import robot_option
from tests.support import commands

pytest.importorskip("scipy")


def run(capsys, *arguments):
    """Exit code, standard output and standard error of a command."""
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def log(capsys, tmp_path):
    path = tmp_path / "log.csv"
    code, out, err = run(capsys, "record-log", "--seconds", 3, "--seed", 1, "-o", path)
    assert (code, out, err) == (0, f"301 rows over 3 s\nwrote {path}\n", "")
    return path


def test_a_log_becomes_a_robot_that_other_commands_accept(capsys, log, tmp_path):
    robot = tmp_path / "mine.toml"
    fields = "body_com_height,lag"
    code, out, err = run(capsys, "identify", log, "--fields", fields, "--threads", 1, "-o", robot)
    assert (code, err) == (0, "")
    header, *lines = out.splitlines()
    assert header.split() == ["parameter", "nominal", "estimate", "±", "95", "%", "unit"]
    assert lines[0].split()[0] == "body_com_height"
    assert lines[1].split()[0] == "lag"
    assert f"wrote {robot}" in lines
    written = bb.Params.from_toml(robot)
    assert written.body_com_height == pytest.approx(0.142, abs=0.01)
    assert written == bb.Params.paper().replace(body_com_height=written.body_com_height)
    assert bb.load_actuators(robot)["lag"] < 0.003
    assert bb.Params(**robot_option(str(robot))) == written
    again = ("--robot", robot, "--fields", "body_com_height", "--threads", 1, "--json")
    code, out, _ = run(capsys, "identify", log, *again)
    found = json.loads(out)
    assert code == 0
    assert found["fitted"]["body_com_height"]["value"] == pytest.approx(written.body_com_height, rel=0.02)
    assert found["file"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("identify", "nowhere.csv"), "nowhere.csv: No such file or directory"),
        (("identify", "log.txt"), "log.txt: the name of a log must end in .csv, .npz or .mcap"),
        (("identify", "LOG", "--fields", "mass"), "unknown field 'mass'"),
        (("identify", "LOG", "--fields", "wheel_mass,body_mass"), "the log does not depend on wheel_mass"),
        (("identify", "LOG", "--fields", "payload_mass"), "fields has payload_mass, but the robot has no payload"),
        (("identify", "LOG", "--robot", "r2d2"), "unknown robot 'r2d2'"),
        (("identify", "LOG", "-o", "robot.json"), "robot.json: the name of a robot's file ends in .toml"),
        (("record-log", "-o", "log.txt"), "log.txt: the name of a log must end in .csv or .npz"),
        (("record-log", "--model", "flat"), "unknown model 'flat'"),
    ],
)
def test_an_error_is_one_line(capsys, log, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *(str(log) if word == "LOG" else word for word in arguments))
    assert (code, out) == (1, "")
    assert message in err
    assert err.startswith("ballbot: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_ctrl_c_ends_a_fit_and_leaves_nothing(log, tmp_path):
    # Small time steps, so that the fit takes long.
    process = commands.start("identify", log, "--sim-dt", "0.00005", "-o", tmp_path / "mine.toml")
    time.sleep(1.5)
    assert process.poll() is None, process.communicate()
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=300)
    assert (process.returncode, printed, errors) == (130, "", "interrupted\n")
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]
