"""The task of a policy is the task of its file; a request for another task is rejected."""

import json

import pytest

pytest.importorskip("onnx", reason="needs 'ballbot-rs[export]'")
pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.control.resolve import common_task, find
from tests.support.onnx_policies import SHIPPED, tiny_policy

TASKS = ["velocity", "goal", "path", "push"]


@pytest.fixture
def policy_of(tmp_path):
    return lambda task: str(tiny_policy(tmp_path / f"{task}.onnx", task))


@pytest.mark.parametrize("task", TASKS)
def test_a_policy_file_names_its_task(policy_of, task):
    found = find(policy_of(task))
    assert found.task == bb.OnnxPolicy(policy_of(task)).task == task
    (result,) = bb.compare([policy_of(task)], episodes=2, max_episode_steps=3)
    metrics = bb.Batch(1, task).metrics(0)
    assert set(result.metrics) == set(metrics)


def test_controllers_compared_with_a_policy_have_its_task(policy_of, capsys):
    path = policy_of("goal")
    arguments = ["--controller", path, "--controller", "lqr", "--episodes", "2", "--json"]
    assert main(["evaluate", *arguments, "--set", "max_episode_steps=3"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["env_id"] == "ballbot/Goal-v0"
    assert [result["controller"] for result in report["results"]] == [path, "lqr"]
    assert all("goals_held" in result["metrics"] for result in report["results"])


def test_another_task_is_rejected(policy_of):
    with pytest.raises(ValueError, match="env_id is 'ballbot/Path-v0', expected 'ballbot/Goal-v0'"):
        find(policy_of("path"), task="goal")
    with pytest.raises(ValueError, match=r"balance\.onnx was trained for the task balance, not for the task of .*push"):
        common_task([find(policy_of("push")), find(str(SHIPPED))])
    with pytest.raises(ValueError, match="was trained for the task goal, not for the task path"):
        bb.compare([find(policy_of("goal"))], task="path", episodes=1)
    with pytest.raises(
        ValueError, match="for the task velocity, whose observations differ from the observations of balance"
    ):
        bb.run_scenarios([policy_of("velocity")])


def test_without_policies_the_task_is_balancing():
    assert common_task([find("lqr")]) == "balance"
    assert common_task([find("lqr")], "goal") == "goal"


def test_a_file_of_stable_baselines_names_its_task(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3", reason="needs 'ballbot-rs[train]'")
    env = bb.BallbotVecEnv(2, task="goal", goal_seconds=(3.0, 4.0))
    path = bb.save(sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=16), tmp_path / "p.zip")
    found = find(path)
    assert found.task == "goal"
    assert found.env_options["goal_seconds"] == [3.0, 4.0]
    with pytest.raises(ValueError, match="env_id is 'ballbot/Goal-v0', expected 'ballbot/Path-v0'"):
        find(path, task="path")
    from ballbot_rs.training.export import export

    pytest.importorskip("onnxscript", reason="needs 'ballbot-rs[export]'")
    export(path, tmp_path / "p.onnx")
    assert bb.OnnxPolicy(tmp_path / "p.onnx").task == "goal"
