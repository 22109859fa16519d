"""`ballbot export` with `.h`: the same headers, and mistakes that are named."""

import json
import re
import subprocess

import pytest

from ballbot_rs import Params
from ballbot_rs.cli import main
from ballbot_rs.deployment import controller_header, estimator_header
from tests.support.c_code import STRICT
from tests.support.paths import ROOT

PAGE = (ROOT / "docs" / "deployment.md").read_text(encoding="utf-8")


def test_the_command_writes_the_requested_controller(tmp_path, capsys):
    target = tmp_path / "gains.h"
    robot = ["--robot", "kugle", "--set", "robot.body_com_offset=[0.01,0]"]
    rate = ["--set", "control_dt=0.005", "--set", "max_wheel_torque=1.5"]
    options = ["--controller-option", "max_lean=0.1", "--controller-option", "traction=0.8"]
    assert main(["export", "--controller", "lqi", *robot, *rate, *options, "-o", str(target)]) == 0
    assert "wrote" in capsys.readouterr().out
    params = Params.preset("kugle").replace(body_com_offset=(0.01, 0.0))
    expected = controller_header("lqi", params, 0.005, max_wheel_torque=1.5, max_lean=0.1, traction=0.8)
    assert target.read_text(encoding="ascii") == expected
    assert "#define BALLBOT_MAX_TORQUE ((ballbot_real)1.5)" in expected


def test_the_report_is_json(tmp_path, capsys):
    target = tmp_path / "gains.h"
    assert main(["export", "--controller", "pid", "-o", str(target), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"controller": "pid", "header": str(target), "options": {}}


def test_the_command_writes_the_estimator_of_a_robot_and_its_sensors(tmp_path, capsys):
    target = tmp_path / "estimator.h"
    given = ["--robot", "kugle", "--sensors", "kugle", "--set", "control_dt=0.005"]
    assert main(["export", "--estimator", *given, "-o", str(target)]) == 0
    assert target.read_text(encoding="ascii") == estimator_header("kugle", "kugle", 0.005)
    capsys.readouterr()


@pytest.mark.slow("a training")
def test_a_run_and_its_onnx_file_give_the_same_header(tiny_run, tmp_path, capsys):
    pytest.importorskip("onnx")
    onnx, first, second = (str(tmp_path / name) for name in ("p.onnx", "a.h", "b.h"))
    for source, target in ((str(tiny_run), onnx), (str(tiny_run), first), (onnx, second)):
        assert main(["export", source, "-o", target]) == 0
    assert (tmp_path / "a.h").read_text(encoding="ascii") == (tmp_path / "b.h").read_text(encoding="ascii")
    capsys.readouterr()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], "takes one of RUN, --controller, --estimator, --supervisor and --link"),
        (["runs/mine", "--controller", "lqr"], "takes one of RUN, --controller, --estimator, --supervisor and --link"),
        (["--controller", "zero"], "'zero' cannot be written as C: expected one of lqr, pid, lqi"),
        (["--controller", "lqr", "-o", "gains.c"], "gains.c: the name of a C header ends in .h"),
        (
            ["runs/mine", "-o", "policy.c"],
            "policy.c: the name of an ONNX file must end in .onnx, of a C header in .h",
        ),
        (["mine.onnx", "-o", "other.onnx"], "mine.onnx is already an ONNX file: write it as a C header"),
        (["--controller", "lqr", "--controller-option", "weight=1"], "unexpected keyword argument 'weight'"),
        (["--controller", "lqr", "--controller-option", "weight"], "--controller-option weight: expected NAME=VALUE"),
        (
            ["--controller", "lqr", "--controller-option", "control_dt=1"],
            "name the robot by --robot and the rest by --set",
        ),
        (["--controller", "lqr", "--sensors", "exact"], "does not depend on sensors of the environment"),
        (["--controller", "lqr", "--task", "balance"], "--task balance is for policies"),
        (["runs/mine", "--controller-option", "position=1"], "--controller-option position=1 needs --controller"),
        (["--estimator"], "--estimator needs the sensors of the robot"),
        (["--estimator", "--sensors", "kugle", "--model", "rigid"], "an estimator in C does not depend on model"),
        (
            ["--estimator", "--sensors", "kugle", "--controller", "lqr"],
            "takes one of RUN, --controller, --estimator, --supervisor and --link",
        ),
        (["--link", "--robot", "kugle"], "--link does not depend on task, robot or environment"),
        (["--link", "-o", "link.c"], "link.c: the name of a C header ends in .h"),
        (["--controller", "lqr", "--set", "control_dt=0"], "control_dt = 0 is out of range"),
    ],
)
def test_mistakes_are_named(given, message, capsys):
    assert main(["export", *given]) == 1
    assert message in capsys.readouterr().err


def test_the_loops_of_the_page_are_compiled_with_the_headers_of_the_page(tmp_path, capsys):
    loops = re.findall(r"```c\n(.*?)```", PAGE, flags=re.DOTALL)
    commands = re.findall(r"^ballbot (export --(?:controller lqi|estimator) .*?) -o (\w+\.h)", PAGE, flags=re.MULTILINE)
    assert [target for _, target in commands] == ["gains.h", "estimator.h"]
    for command, target in commands:
        assert main([*command.split(), "-o", str(tmp_path / target)]) == 0
    assert len(loops) == 3
    for loop in loops:
        (tmp_path / "main.c").write_text(loop, encoding="utf-8")
        compiler = ["cc", *STRICT, "-c", "-o", tmp_path / "main.o", tmp_path / "main.c"]
        done = subprocess.run(compiler, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
    capsys.readouterr()
