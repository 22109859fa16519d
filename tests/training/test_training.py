"""Training: the configuration, what a run leaves behind, and what the trained policies are compared with."""

import json
import shutil
import zipfile

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from ballbot_rs import BallbotVecEnv, __version__
from ballbot_rs.analysis.episodes import evaluate
from ballbot_rs.control.sb3_policy import METADATA, find_file, load
from ballbot_rs.training import config, run_folder, train
from tests.support.names import BALANCE
from tests.support.tiny_config import TINY_CONFIG


def bad(old, new):
    assert old in TINY_CONFIG, "the test edits nothing"
    return TINY_CONFIG.replace(old, new, 1)


class TestConfig:
    def test_the_default_configuration_is_complete(self):
        loaded, text = config.load("balance")
        assert loaded == config.parse(text, "again")
        assert (loaded.env_id, loaded.algorithm) == (BALANCE, "PPO")
        assert loaded.total_timesteps > 100_000

    def test_every_key_arrives(self):
        parsed = config.parse(TINY_CONFIG, "tiny")
        assert parsed.env == {"model": "spatial", "max_episode_steps": 60}
        assert parsed.evaluation == config.Evaluation(every_timesteps=256, episodes=4)
        assert parsed.algorithm_arguments["n_steps"] == 32
        assert parsed.schedule == {"learning_rate": "linear"}
        assert parsed.policy == {"net_arch": [8]}

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("a = ", "source: "),
            ("", "it is empty, expected at least one of env_id, "),
            ("# nothing", "it is empty"),
            ("total_timestep = 5", "unknown key 'total_timestep': expected one of env_id, "),
            ("[evaluation]\nepisode = 5", r"\[evaluation\]: unknown key 'episode': expected one of every_timesteps"),
            ("env_id = 'ballbot/Walk-v0'", "unknown environment 'ballbot/Walk-v0': expected ballbot/Balance-v0"),
            ("algorithm = 'DQN'", "unknown algorithm 'DQN': expected one of PPO, SAC"),
            ("total_timesteps = 0", "total_timesteps = 0 is out of range: .* at least 1"),
            ("num_envs = -4", "num_envs = -4 is out of range"),
            ("num_envs = 2.5", "num_envs = 2.5 is out of range: it must be a whole number"),
            ("torch_threads = true", "torch_threads = True is out of range"),
            ("num_threads = 0", "num_threads = 0 is out of range"),
            ("num_threads = 'all'", "num_threads = 'all' is out of range"),
            ("[evaluation]\nepisodes = 0", "evaluation.episodes = 0 is out of range"),
            ("evaluation = 5", "evaluation = 5 must be a table"),
            ("env = 5", "env = 5 must be a table"),
            ("schedule = []", r"schedule = \[\] must be a table"),
            ("policy = 'big'", "policy = 'big' must be a table"),
            ("algorithm_arguments = 1", "algorithm_arguments = 1 must be a table"),
            ("schedule.gamma = 'linear'", "schedule.gamma has no value of that name"),
            ("schedule.gamma = 'cosine'\nalgorithm_arguments.gamma = 0.9", "'cosine': expected 'linear'"),
            ("schedule.gamma = 'linear'\nalgorithm_arguments.gamma = 'x'", "gamma = 'x': a scheduled value must be"),
        ],
    )  # fmt: skip
    def test_mistakes_are_named_with_their_source(self, text, message):
        with pytest.raises(ValueError, match=message) as caught:
            config.parse(text, "source")
        assert str(caught.value).startswith("source: ")

    def test_unknown_tasks_and_files(self, tmp_path):
        with pytest.raises(ValueError, match="unknown task 'walk': expected one of balance"):
            config.load("walk")
        with pytest.raises(ValueError, match="unknown task 'walk'"):
            config.load("walk", tmp_path / "tiny.toml")
        with pytest.raises(FileNotFoundError):
            config.load("balance", tmp_path / "nowhere.toml")

    @pytest.mark.parametrize("written", ["total_timesteps = 768", "  total_timesteps=768", "total_timesteps   = 7_68"])
    def test_other_timesteps_change_nothing_else(self, written):
        text = config.with_values(bad("total_timesteps = 768", written), {"total_timesteps": 99})
        expected = config.parse(TINY_CONFIG, "tiny")
        found = config.parse(text, "changed")
        assert found.total_timesteps == 99
        assert {**vars(found), "total_timesteps": 768} == vars(expected)


class TestRun:
    def test_leaves_everything_behind(self, tiny_run):
        assert (tiny_run / "config.toml").read_text(encoding="utf-8") == TINY_CONFIG
        record = json.loads((tiny_run / "run.json").read_text(encoding="utf-8"))
        assert record["seed"] == 5
        assert record["versions"]["ballbot_rs"] == __version__
        assert set(record["versions"]) == {"ballbot_rs", "gymnasium", "stable_baselines3", "torch", "python"}
        steps = sorted(int(path.stem.split("_")[-2]) for path in (tiny_run / "checkpoints").glob("*.zip"))
        assert steps == [256, 512, 768]
        assert list((tiny_run / "tensorboard").rglob("events.*"))
        evaluations = np.load(tiny_run / "evaluations.npz")
        assert evaluations["timesteps"].tolist() == [256, 512, 768]
        assert evaluations["results"].shape == (3, 4)

    def test_keeps_the_best_policy(self, tiny_run):
        evaluations = np.load(tiny_run / "evaluations.npz")
        best = evaluations["timesteps"][evaluations["results"].mean(axis=1).argmax()]
        assert PPO.load(tiny_run / "best_model.zip").num_timesteps == best
        assert PPO.load(tiny_run / "final_model.zip").num_timesteps == 768
        assert find_file(tiny_run) == tiny_run / "best_model.zip"

    def test_a_policy_states_what_it_was_trained_for(self, tiny_run):
        model, found = load(tiny_run, "balance")
        assert isinstance(model, PPO)
        assert found == getattr(model, METADATA)
        assert found["env_id"] == BALANCE
        assert found["algorithm"] == "PPO"
        assert found["env_options"] == BallbotVecEnv(1, model="spatial", max_episode_steps=60).task_options
        assert len(found["observation"]) == 16
        with zipfile.ZipFile(tiny_run / "best_model.zip") as archive:
            assert json.loads(archive.read("data"))[METADATA] == found, "other tools cannot read the metadata"

    def test_the_learning_rate_falls_linearly(self, tiny_run):
        rates = [
            PPO.load(path).policy.optimizer.param_groups[0]["lr"]
            for path in sorted((tiny_run / "checkpoints").glob("*.zip"))
        ]
        # A checkpoint has the rate of the update before it.
        np.testing.assert_allclose(rates, [1e-3 * (1 - 256 / 768), 1e-3 * (1 - 512 / 768), 0.0], rtol=1e-6)

    def test_is_reproducible(self, tiny_run, tmp_path):
        train.train(config.parse(TINY_CONFIG, "tiny"), TINY_CONFIG, tmp_path / "again", seed=5, progress_bar=False)
        first, second = (PPO.load(folder / "final_model.zip") for folder in (tiny_run, tmp_path / "again"))
        for a, b in zip(first.policy.parameters(), second.policy.parameters(), strict=True):
            assert torch.equal(a, b)

    def test_sac_too(self, tmp_path):
        text = bad('algorithm = "PPO"', 'algorithm = "SAC"').replace("n_steps = 32\n", "learning_starts = 50\n")
        text = text.replace("n_epochs = 1\n", "buffer_size = 1000\n").replace("768", "256")
        folder = tmp_path / "sac"
        policy = train.train(config.parse(text, "sac"), text, folder, progress_bar=False)
        assert load(policy, "balance")[1]["algorithm"] == "SAC"
        assert evaluate(str(folder), episodes=2).episodes == 2

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("n_steps = 32", "n_step = 32"),
            ("n_steps = 32", "n_steps = 0"),
            ("n_steps = 32", "n_steps = 'many'"),
            ("batch_size = 64", "batch_size = 1"),
            ("net_arch", "net_arc"),
            ('model = "spatial"', 'modle = "spatial"'),
            ('model = "spatial"', 'model = "spatia"'),
            ('model = "spatial"', "num_envs = 3"),
        ],
    )
    def test_a_rejected_configuration_changes_nothing(self, tiny_run, tmp_path, old, new):
        text = bad(old, new)
        with pytest.raises(ValueError, match=r"does not fit PPO|unknown model|n_steps = .* is out of range"):
            train.train(config.parse(text, "bad"), text, tmp_path / "new", progress_bar=False)
        assert not (tmp_path / "new").exists()
        run = shutil.copytree(tiny_run, tmp_path / "old")
        with pytest.raises(ValueError, match=r"does not fit PPO|unknown model|n_steps = .* is out of range"):
            train.train(config.parse(text, "bad"), text, run, overwrite=True, progress_bar=False)
        assert (run / "best_model.zip").is_file(), "the earlier run was deleted"
        assert (run / "config.toml").read_text(encoding="utf-8") == TINY_CONFIG

    def test_a_training_that_diverges_reports_it_and_leaves_nothing_to_resume(self, tmp_path):
        text = config.with_values(TINY_CONFIG, {"algorithm_arguments.learning_rate": 1e30})
        with pytest.raises(ValueError, match=r"the training has diverged after \d+ steps: Expected parameter \w+$"):
            train.train(config.parse(text, "fast"), text, tmp_path / "run", progress_bar=False)
        for checkpoint in run_folder.checkpoints(tmp_path / "run"):
            assert torch.isfinite(PPO.load(checkpoint).policy.log_std).all()

    def test_an_earlier_run_is_not_overwritten_by_default(self, tiny_run, tmp_path):
        parsed = config.parse(TINY_CONFIG, "tiny")
        run = shutil.copytree(tiny_run, tmp_path / "run")
        with pytest.raises(
            FileExistsError,
            match="holds an earlier run: continue it with --resume, delete it with --overwrite, or name another",
        ):
            train.train(parsed, TINY_CONFIG, run, progress_bar=False)
        (tmp_path / "other").mkdir()
        (tmp_path / "other" / "thesis.tex").write_text("do not delete")
        with pytest.raises(FileExistsError, match="is not a training run, so it is not overwritten"):
            train.train(parsed, TINY_CONFIG, tmp_path / "other", overwrite=True, progress_bar=False)
        assert (tmp_path / "other" / "thesis.tex").is_file()
        train.train(parsed, TINY_CONFIG, run, seed=6, overwrite=True, progress_bar=False)
        assert json.loads((run / "run.json").read_text())["seed"] == 6


class TestResume:
    @pytest.fixture
    def interrupted(self, tiny_run, tmp_path):
        """A run that was to have 1024 steps and stopped after 512."""
        run = shutil.copytree(tiny_run, tmp_path / "run")
        (run / "config.toml").write_text(config.with_values(TINY_CONFIG, {"total_timesteps": 1024}), encoding="utf-8")
        (run / "checkpoints" / "rl_model_768_steps.zip").unlink()
        (run / "final_model.zip").unlink()
        return run

    def test_reaches_the_configured_number_of_steps(self, interrupted):
        train.resume(interrupted, progress_bar=False)
        assert PPO.load(interrupted / "final_model.zip").num_timesteps == 1024
        assert (interrupted / "checkpoints" / "rl_model_1024_steps.zip").is_file()
        assert load(interrupted, "balance")[1]["env_options"]["max_episode_steps"] == 60

    def test_only_a_better_policy_replaces_the_best(self, interrupted):
        record = dict(np.load(interrupted / "evaluations.npz"))
        record["results"][record["timesteps"] == PPO.load(interrupted / "best_model.zip").num_timesteps] = 1e6
        np.savez(interrupted / "evaluations.npz", **record)
        before = (interrupted / "best_model.zip").read_bytes()
        assert train.resume(interrupted, progress_bar=False) == interrupted / "best_model.zip"
        assert (interrupted / "best_model.zip").read_bytes() == before
        assert np.load(interrupted / "evaluations.npz")["timesteps"].tolist() == [256, 512, 768, 1024]

    def test_a_finished_run_continues_for_more_steps(self, tiny_run, tmp_path):
        run = shutil.copytree(tiny_run, tmp_path / "run")
        train.resume(run, timesteps=1024, progress_bar=False)
        assert PPO.load(run / "final_model.zip").num_timesteps == 1024
        assert config.load("balance", run / "config.toml")[0].total_timesteps == 1024

    def test_a_finished_run_stays_as_it_is(self, tiny_run, tmp_path):
        run = shutil.copytree(tiny_run, tmp_path / "run")
        assert train.resume(run, progress_bar=False) == run / "best_model.zip"
        assert PPO.load(run / "final_model.zip").num_timesteps == 768

    def test_two_processes_do_not_train_in_one_folder(self, tiny_run, tmp_path):
        run = tmp_path / "run"
        shutil.copytree(tiny_run, run)
        before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
        parsed = config.parse(TINY_CONFIG, "tiny")
        with run_folder.held(run):
            with pytest.raises(ValueError, match="run: another process is training there"):
                train.resume(run, timesteps=5000, progress_bar=False)
            with pytest.raises(ValueError, match="run: another process is training there"):
                train.train(parsed, TINY_CONFIG, run, overwrite=True, progress_bar=False)
        assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
        # The folder is free again.
        train.train(parsed, TINY_CONFIG, run, seed=6, overwrite=True, progress_bar=False)

    def test_runs_that_cannot_be_resumed(self, interrupted, tmp_path):
        with pytest.raises(FileNotFoundError, match="holds no training run"):
            train.resume(tmp_path / "nowhere")
        shutil.rmtree(interrupted / "checkpoints")
        with pytest.raises(FileNotFoundError, match="has no checkpoint to resume from"):
            train.resume(interrupted)


class TestEvaluation:
    def test_lqr_succeeds_and_doing_nothing_fails(self):
        lqr = evaluate("lqr", episodes=100)
        assert (lqr.model, lqr.episodes, lqr.control_dt) == ("contact", 100, 0.01)
        assert lqr.success_rate >= 0.99
        assert lqr.survival_rate >= 0.99
        assert lqr.settling_time < 3.0
        assert lqr.mean_reward > 0.9
        zero = evaluate("zero", episodes=100)
        assert (zero.success_rate, zero.survival_rate, zero.settling_time) == (0.0, 0.0, None)
        assert zero.torque_rms == 0.0
        assert zero.mean_reward < 0.1
        assert zero.tilt_rms > 5 * lqr.tilt_rms

    def test_pid_runs_at_its_rate(self):
        options = {"model": "spatial"}
        pid = evaluate("pid", episodes=5, **options)
        assert pid.control_dt == 0.002
        assert pid.survival_rate == 1.0
        slower = evaluate("pid", episodes=5, **options, control_dt=0.004)
        assert slower.control_dt == 0.004

    def test_results_depend_on_seeds_not_on_threads(self):
        first = evaluate("lqr", episodes=6, num_threads=1, model="spatial")
        assert evaluate("lqr", episodes=6, num_threads=2, model="spatial") == first
        assert evaluate("lqr", episodes=6, seed=1, model="spatial") != first

    def test_a_policy_runs_on_what_it_was_trained_for(self, tiny_run):
        result = evaluate(str(tiny_run), episodes=3)
        assert result.model == "spatial"
        assert evaluate(str(tiny_run), episodes=3, model="planar").model == "planar"
