"""Trainings continue until their policy succeeds, or report that it does not."""

import json

import numpy as np
import pytest

from ballbot_rs import Params
from ballbot_rs._core import TASKS
from ballbot_rs.cli import main
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
