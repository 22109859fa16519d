"""`ballbot view TASK`: the command runs the task that is named, or the policy's task."""

import subprocess
import sys

import pytest

from tests.support.paths import ASSETS

pytest.importorskip("viser", reason="needs 'ballbot-rs[view]'")

POLICY = str(ASSETS / "policies" / "velocity.onnx")


def view(*arguments, code=0):
    command = [sys.executable, "-m", "ballbot_rs.cli", "view", *arguments, "--seconds", "1", "--no-open"]
    done = subprocess.run([*command, "--port", "18970"], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


@pytest.mark.slow("a page per task")
@pytest.mark.parametrize("task", ["velocity", "goal", "path", "push"])
def test_a_task_is_run_with_a_law(task):
    assert f"({task}, 1 robot paper, contact, lqr)" in view(task, "--controller", "lqr")


@pytest.mark.slow("a page per task")
def test_a_policy_is_run_in_its_task_with_options(tmp_path):
    pytest.importorskip("onnx", reason="needs 'ballbot-rs[export]'")
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    from tests.support.onnx_policies import tiny_policy

    path = str(tiny_policy(tmp_path / "p.onnx", "velocity"))
    assert f"(velocity, 2 robots paper, contact, {path})" in view(
        "--controller", path, "--batch", "2", "--set", "speed=0.3"
    )
    assert "expected 'ballbot/Goal-v0'" in view("goal", "--controller", path, code=1)


def test_an_option_of_another_task_is_rejected():
    error = view("goal", "--set", "path_speed=[0.1,0.2]", code=1)
    assert "path_speed" in error


@pytest.mark.slow("a page per task")
def test_a_policy_replaces_the_task_argument():
    assert f"(velocity, 1 robot paper, contact, {POLICY})" in view(POLICY)


@pytest.mark.parametrize("order", [1, -1])
def test_a_page_has_a_single_controller(order):
    first, second = [[POLICY], ["--controller", "lqr"]][::order]
    assert f"{POLICY} and --controller lqr: this command takes one controller" in view(*first, *second, code=2)
