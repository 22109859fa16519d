"""Trainings continue until their policy succeeds, or report that it does not."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecMonitor

from ballbot_rs import BallbotVecEnv, Params, evaluate
from ballbot_rs._core import TASKS
from ballbot_rs.cli import main
from ballbot_rs.control import sb3_policy
from ballbot_rs.envs._batch_env import without_curriculum
from ballbot_rs.envs.registration import task_of
from ballbot_rs.training import callbacks, config, run_folder, train
from tests.support.killed_training import weights
from tests.support.tiny_config import TINY_CONFIG


def text_with(**values):
    return config.with_values(TINY_CONFIG, values)


def trained(text, folder):
    train.train(config.parse(text, "tiny"), text, folder, seed=5, progress_bar=False)
    evaluations = run_folder.read_evaluations(folder)
    return run_folder.read_record(folder), evaluations.timesteps.tolist()


@pytest.mark.slow("a training")
def test_a_run_that_does_not_succeed_takes_all_steps_and_fails(tmp_path, capsys):
    text = text_with(**{"evaluation.success": 1.0, "max_timesteps": 1536})
    (tmp_path / "tiny.toml").write_text(text, encoding="utf-8")
    run = tmp_path / "run"
    code = main(["train", "--config", str(tmp_path / "tiny.toml"), "--run", str(run), "--episodes", "4", "--quiet"])
    out, err = capsys.readouterr()
    assert code == 1
    reason = "after 1536 steps the best policy succeeds in 0% of the episodes of nominal robots, expected at least 100%"
    assert err.splitlines()[-1] == f"ballbot: the training has failed: {reason}"
    assert "best policy: " in out, "the results are shown all the same"
    assert f"failed: {reason}" in (run / "report.html").read_text(encoding="utf-8")
    assert run_folder.read_evaluations(run).timesteps.tolist() == [256, 512, 768, 1024, 1280, 1536]
    # Nothing is left to learn: it has failed still.
    assert main(["train", "--resume", str(run), "--episodes", "0", "--no-report", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["success"], found["required_success"], found["timesteps"]) == (0.0, 1.0, 1536)


def test_a_run_ends_once_its_best_policy_succeeds(tmp_path, monkeypatch):
    shares = iter([0.2, 0.9])
    monkeypatch.setattr(callbacks.KeepBest, "success_of_best", lambda _: next(shares, 0.9))
    text = text_with(**{"evaluation.success": 0.8, "max_timesteps": 10_000})
    record, timesteps = trained(text, tmp_path / "run")
    # Success is required from the configured steps on.
    assert timesteps == [256, 512, 768, 1024]
    assert (record["success"], record["required_success"], record["timesteps"]) == (0.9, 0.8, 1024)
    assert run_folder.failure(record) is None


def test_nothing_is_required_by_default(tmp_path):
    record, timesteps = trained(text_with(), tmp_path / "run")
    assert timesteps == [256, 512, 768]
    assert "success" not in record
    assert run_folder.failure(record) is None


def test_evaluating_the_best_policy_does_not_change_the_training(tmp_path):
    plain = text_with()
    judged = text_with(**{"evaluation.success": 0.0, "max_timesteps": 768})
    trained(plain, tmp_path / "plain")
    record, _ = trained(judged, tmp_path / "judged")
    assert record["success"] >= 0.0
    for name in (run_folder.BEST, run_folder.FINAL):
        assert weights(tmp_path / "plain" / name) == weights(tmp_path / "judged" / name)


def configurations_that_require_success():
    for file in sorted((Path(config.__file__).parent / "configs").glob("*.toml")):
        parsed = config.parse(file.read_text(encoding="utf-8"), file.name)
        # The laws ignore the rules of openballbot, and a family has more than one robot.
        if parsed.evaluation.success is not None and file.stem not in ("openballbot", "balance-any"):
            yield pytest.param(parsed, id=file.stem)


@pytest.mark.parametrize("parsed", list(configurations_that_require_success()))
def test_a_law_has_the_success_that_a_training_requires(parsed):
    left_out = ("events", "history", "observation", "scale_by_robot")
    options = {name: value for name, value in without_curriculum(parsed.env).items() if name not in left_out}
    task = task_of(parsed.env_id)
    # The fastest law spills.
    law = "lqr" if task == "carry" else "mpc"
    found = evaluate(law, task=task, episodes=20, **options)
    assert found.success_rate >= parsed.evaluation.success


def seen_and_judged(model, seed):
    """An evaluation of a model in Rust, and by Stable-Baselines3."""
    robots = VecMonitor(BallbotVecEnv(6, max_episode_steps=60))
    return callbacks.evaluated(model, robots, 6, seed), callbacks._evaluated_by_sb3(model, robots, 6, seed)


def network(seed, **policy):
    return PPO("MlpPolicy", BallbotVecEnv(1), seed=seed, device="cpu", policy_kwargs={"net_arch": [8], **policy})


@pytest.mark.parametrize("net_arch", [[], [8], [16, 8]])
def test_a_policy_is_evaluated_in_rust_as_in_python(net_arch):
    model = network(3, net_arch=net_arch)
    # The first actions of a learner are too small to topple a robot, or to be limited.
    with torch.no_grad():
        for weights in model.policy.action_net.parameters():
            weights.mul_(300.0)
    assert sb3_policy.tanh_network(model) is not None
    # Stable-Baselines3 lists the episodes as they end.
    found, expected = (np.sort(results, axis=1) for results in seen_and_judged(model, 7))
    np.testing.assert_array_equal(found[1:], expected[1:])
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-4)
    assert len(set(found[1])) > 1


def with_weight(value):
    model = network(0)
    with torch.no_grad():
        model.policy.action_net.weight[0, 0] = value
    return model


@pytest.mark.parametrize(
    "model",
    [
        lambda: network(0, activation_fn=torch.nn.ReLU),
        lambda: network(0, net_arch=[128, 128]),
        lambda: SAC("MlpPolicy", BallbotVecEnv(1), buffer_size=10, device="cpu", policy_kwargs={"net_arch": [8]}),
        lambda: with_weight(2e9),
        lambda: with_weight(float("nan")),
    ],
    ids=["relu", "wide", "SAC", "huge", "NaN"],
)
def test_other_policies_are_evaluated_by_stable_baselines3(model):
    assert sb3_policy.tanh_network(model()) is None


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"max_timesteps": 700}, "max_timesteps = 700 is below total_timesteps = 768"),
        ({"max_timesteps": 0}, "max_timesteps = 0 is out of range"),
        ({"evaluation.success": 1.5}, "evaluation.success = 1.5 is out of range: it must be from 0 to 1"),
        ({"horizon": 0.0}, "horizon = 0.0 is out of range: it must be from 0.01 to 1e6"),
    ],
)
def test_mistakes_are_named(values, message):
    with pytest.raises(ValueError, match=message):
        config.parse(text_with(**values), "tiny")


def test_the_steps_of_the_command_line_are_exact():
    loaded, text = config.load("balance")
    assert loaded.max_timesteps > loaded.total_timesteps
    fixed = config.parse(config.with_values(text, config.steps_alone(loaded, 4096)), "balance")
    assert (fixed.total_timesteps, fixed.max_timesteps) == (4096, 4096)


def test_a_rate_falls_again_in_each_round():
    rate = train._linear(2.0, 100, 400)
    steps = np.array([0, 25, 100, 125, 200, 350, 400])
    np.testing.assert_allclose([rate(1.0 - done / 400) for done in steps], [2.0, 1.5, 0.0, 1.5, 0.0, 1.0, 0.0])
    alone = train._linear(2.0, 400, 400)
    np.testing.assert_allclose([alone(1.0 - done / 400) for done in (0, 100, 400)], [2.0, 1.5, 0.0])


def test_the_discount_follows_the_robot():
    found = {
        robot: config.parse(config.with_values(config.default_text("balance"), {"env.robot": robot}), robot).arguments()
        for robot in ("paper", "kugle", "rezero", "asroballet")
    }
    assert found["paper"]["gamma"] == pytest.approx(0.98, abs=1e-3)
    # A body twice as high topples more slowly, and what is done to it shows later.
    assert found["paper"]["gamma"] < found["kugle"]["gamma"] < 1.0
    assert Params.preset("kugle").body_com_height > 2.0 * Params.paper().body_com_height
    own = config.parse(
        config.with_values(config.default_text("balance"), {"algorithm_arguments.gamma": 0.9}), "own"
    ).arguments()
    assert own["gamma"] == 0.9


@pytest.mark.parametrize("task", TASKS)
def test_every_configuration_defines_success(task):
    assert 0.5 <= config.load(task)[0].evaluation.success <= 1.0


def test_a_robot_with_a_variant_is_trained_with_it():
    own, text = config.load("balance", None, "rezero")
    assert text == config.default_text("balance", "rezero")
    assert own.env == {**config.load("balance")[0].env, "robot": "rezero"}
    assert config.load("balance", None, "kugle") == config.load("balance")
