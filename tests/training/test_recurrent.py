"""Recurrent policies of sb3-contrib: the fit over sequences, training and resuming, files, and what is rejected."""

import dataclasses
import json
import re
import sys
import zipfile

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.control import sb3_policy, sb3_recurrent
from ballbot_rs.training import config, export, teacher, teacher_sequences, train
from ballbot_rs.training.teacher_rounds import Round
from tests.support.killed_training import weights

sb3_contrib = pytest.importorskip("sb3_contrib")

#: No schedule: what a run has learned does not depend on the steps to come.
TINY = """\
env_id = "ballbot/Balance-v0"
algorithm = "RecurrentPPO"
total_timesteps = 512
num_envs = 8
num_threads = 1
symmetric = true

[env]
model = "spatial"
max_episode_steps = 50

[teacher]
controller = "lqr"
rounds = 2
steps = 20
window = 8
value_rollouts = 1

[evaluation]
every_timesteps = 256
episodes = 4

[algorithm_arguments]
n_steps = 32
batch_size = 64
n_epochs = 1

[policy]
net_arch = [6]
lstm_hidden_size = 6
n_lstm_layers = 2
"""

FIT = config.Teacher("lqr", rounds=6, steps=40, epochs=12, batch_size=256, window=16, learning_rate=1e-2)


def new_model(seed=0, **options):
    env = bb.BallbotVecEnv(32, model="spatial", num_threads=1, seed=seed, **options)
    policy = {"net_arch": [], "lstm_hidden_size": 12}
    return sb3_contrib.RecurrentPPO("MlpLstmPolicy", env, n_steps=16, batch_size=256, policy_kwargs=policy, seed=seed)


def law_of(model, fit=FIT):
    (law,) = teacher.laws_of(model, fit)
    return law


def cut(*rows_and_length):
    """Windows of a round whose arrays have robots first."""
    *rows, length = rows_and_length
    return teacher_sequences._cut(Round(*(one.swapaxes(0, 1) for one in rows)), length)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recurrent") / "run"
    train.train(config.parse(TINY, "tiny"), TINY, folder, seed=2, progress_bar=False)
    return folder


class TestFit:
    @pytest.mark.parametrize("continues", [False, True])
    def test_the_error_falls_and_the_value_function_stays(self, continues):
        fit = dataclasses.replace(FIT, continues=continues)
        model = new_model()
        policy = model.policy
        value = [one.clone() for one in (*policy.lstm_critic.parameters(), *policy.value_net.parameters())]
        errors = teacher.fit_actor(model, law_of(model), fit, seed=0)
        assert errors[-1] < 0.5 * errors[0]
        after = [*policy.lstm_critic.parameters(), *policy.value_net.parameters()]
        assert all(torch.equal(one, other) for one, other in zip(value, after, strict=True))
        actor = [one.clone() for one in teacher._actor(model)]
        teacher.fit_value(model, 2)
        assert all(torch.equal(one, other) for one, other in zip(actor, teacher._actor(model), strict=True))
        assert not all(torch.equal(one, other) for one, other in zip(value, after, strict=True))
        assert (model.num_timesteps, model._n_updates) == (0, 0)

    def test_it_infers_what_an_observation_does_not_show(self):
        """A robot whose center of mass is off balances elsewhere, which only the past shows."""
        offset = {"events": [{"term": "body_com_offset", "range": [-0.006, 0.006]}]}
        fit = config.Teacher(
            "lqr", drawn=True, rounds=10, steps=60, epochs=12, batch_size=512, window=30, learning_rate=1e-2
        )
        model = new_model(max_episode_steps=200, **offset)
        recurrent = teacher.fit_actor(model, law_of(model, fit), fit, seed=0)[-1]
        env = bb.BallbotVecEnv(32, model="spatial", num_threads=1, max_episode_steps=200, **offset)
        plain = PPO("MlpPolicy", env, n_steps=16, batch_size=256, policy_kwargs={"net_arch": [30]}, seed=0)
        without = teacher.fit_actor(plain, law_of(plain, fit), fit, seed=0)[-1]
        print(f"root mean square errors: {recurrent:.4f} with a state, {without:.4f} without")
        assert recurrent < 0.8 * without

    def test_windows_begin_in_the_states_of_a_step_by_step_pass(self):
        model, rng = new_model(), np.random.default_rng(0)
        n, steps, lengths = 32, 21, (8, 8, 5)
        seen = rng.normal(size=(n, steps, 16)).astype(np.float32)
        starts = rng.random((n, steps)) < 0.1
        starts[:, 0] = True
        labels = np.zeros((n, steps, 3), np.float32)
        windows = cut(seen, labels, np.ones((n, steps), np.float32), starts, 8)
        assert [one.labels.shape[1] for one in windows] == list(lengths)
        states = teacher_sequences.states_before(model, windows)
        policy, state = sb3_recurrent.RecurrentModel(model), np.zeros((n, 24), np.float32)
        for step in range(steps):
            state[starts[:, step]] = 0.0
            if step % 8 == 0:
                outputs, cells = states[step // 8]
                expected = torch.cat([outputs[0], cells[0]], dim=1).numpy()
                np.testing.assert_allclose(expected, state, atol=1e-6)
            _, state = policy.step(seen[:, step], state)

    def test_an_epoch_does_not_depend_on_how_episodes_are_joined(self):
        """Two episodes of one robot one after the other count as two robots with an episode each."""
        rng = np.random.default_rng(1)
        seen = rng.normal(size=(4, 16, 16)).astype(np.float32)
        labels = rng.uniform(-1.0, 1.0, (4, 16, 3)).astype(np.float32)
        starts = np.zeros((4, 16), dtype=bool)
        starts[:, [0, 8]] = True
        rows = seen, labels, rng.uniform(0.5, 2.0, (4, 16)).astype(np.float32), starts
        joined = cut(*rows, 16)
        apart = cut(*(np.concatenate([one[:, :8], one[:, 8:]]) for one in rows), 16)
        found = []
        for windows in (joined, apart):
            model = new_model()
            parameters = teacher._actor(model)
            whole = config.Teacher("lqr", batch_size=64)
            error = teacher_sequences._epoch(model, torch.optim.SGD(parameters, lr=0.1), windows, whole)
            found.append((error, [one.detach().clone() for one in parameters]))
        assert found[0][0] == pytest.approx(found[1][0], rel=1e-5)
        for one, other in zip(found[0][1], found[1][1], strict=True):
            torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


class TestRun:
    def test_a_resumed_run_is_the_uninterrupted_run(self, run, tmp_path):
        whole, told = tmp_path / "whole", []
        longer = config.with_values(TINY, {"total_timesteps": 1024})
        train.train(config.parse(longer, "longer"), longer, whole, seed=2, progress_bar=False)
        train.resume(run, timesteps=1024, progress_bar=False, tell=told.append)
        assert len(told) == 1
        assert weights(run / "final_model.zip") == weights(whole / "final_model.zip")
        np.testing.assert_array_equal(*(np.load(folder / "evaluations.npz")["results"] for folder in (run, whole)))

    def test_a_checkpoint_of_another_network_is_named(self):
        model = new_model()
        model.learn(model.n_steps * model.n_envs)
        found = sb3_recurrent.states_of_learner(model)
        assert np.abs(found["lstm_pi_cells"]).max() > 0.0
        with pytest.raises(ValueError, match=r"lstm_vf_outputs has shape \(1, 3\), expected \(1, 32, 12\)"):
            sb3_recurrent.give_states_to_learner(model, {**found, "lstm_vf_outputs": np.zeros((1, 3))})
        with pytest.raises(KeyError):
            sb3_recurrent.give_states_to_learner(model, {})

    def test_every_command_takes_the_run_and_its_export(self, run, tmp_path, capsys):
        target = tmp_path / "policy.onnx"
        assert main(["export", str(run), "-o", str(target), "--json"]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["difference"] < export.TOLERANCE
        assert report["metadata"]["state"] == {"cell": "LSTM", "layers": 2, "units": 6}
        shared = ["--episodes", "6", "--json"]
        results = []
        for source in (run, target):
            assert main(["evaluate", str(source), *shared]) == 0
            results.append(json.loads(capsys.readouterr().out))
        first, second = (json.dumps(one, sort_keys=True) for one in results)
        numbers = [np.array([float(x) for x in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)]) for text in (first, second)]
        np.testing.assert_allclose(*numbers, rtol=1e-3, atol=1e-4)

    def test_exported_actions_are_the_model_s(self, run, tmp_path):
        model, _ = sb3_policy.load(run)
        with torch.no_grad():
            model.policy.action_net.weight.mul_(100.0)
        sb3_policy.write(model, tmp_path / "loud.zip")
        export.export(tmp_path / "loud.zip", tmp_path / "loud.onnx")
        policy, state, own = bb.OnnxPolicy(tmp_path / "loud.onnx"), None, None
        rng = np.random.default_rng(4)
        own = policy.initial_state(5)
        spread = []
        for _ in range(20):
            seen = rng.normal(0.0, 1.0, (5, 16)).astype(np.float32)
            expected, state = model.predict(seen, state=state, deterministic=True)
            found, own = policy.step(seen, own)
            np.testing.assert_allclose(found, expected, atol=1e-5)
            spread.append(found)
        assert np.std(spread) > 0.1

    def test_a_network_that_amplifies_differences_is_exported(self, run, tmp_path):
        model, _ = sb3_policy.load(run)
        with torch.no_grad():
            for name, weights_of in model.policy.lstm_actor.named_parameters():
                weights_of.mul_(100.0 if "hh" in name else 10.0)
        sb3_policy.write(model, tmp_path / "chaos.zip")
        assert export.export(tmp_path / "chaos.zip", tmp_path / "chaos.onnx") < export.TOLERANCE

    def test_without_the_library_a_file_names_the_extra(self, run, monkeypatch):
        monkeypatch.setitem(sys.modules, "sb3_contrib", None)
        with pytest.raises(ModuleNotFoundError, match=r"a policy of RecurrentPPO needs sb3_contrib: install it with"):
            sb3_policy.load(run)

    def test_no_code_in_the_file_is_run(self, run, recwarn):
        model, found = sb3_policy.load(run)
        assert found["algorithm"] == "RecurrentPPO"
        assert isinstance(model, sb3_contrib.RecurrentPPO)
        assert not [one for one in recwarn if "runs code" in str(one.message)]

    def test_a_plain_file_is_recognized(self, tmp_path):
        model = new_model()
        model.save(tmp_path / "plain.zip")
        with pytest.warns(UserWarning, match="runs code"):
            _, found = sb3_policy.load(tmp_path / "plain.zip", "balance", {"model": "spatial"})
        assert found["algorithm"] == "RecurrentPPO"

    def test_a_huge_cell_in_a_file_is_rejected(self, run, tmp_path):
        huge = tmp_path / "huge.zip"
        with zipfile.ZipFile(run / "best_model.zip") as old, zipfile.ZipFile(huge, "w") as new:
            for name in old.namelist():
                content = old.read(name)
                if name == "data":
                    data = json.loads(content)
                    data["policy_kwargs"] = {"lstm_hidden_size": 10**6}
                    content = json.dumps(data).encode()
                new.writestr(name, content)
        with pytest.raises(ValueError, match=r"lstm_hidden_size = 1000000, n_lstm_layers = 1: .* weights"):
            sb3_policy.load(huge)


class TestRejected:
    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({"policy.lstm_hidden_size": 0}, "lstm_hidden_size = 0 is out of range"),
            ({"policy.n_lstm_layers": 1.5}, "n_lstm_layers = 1.5 is out of range"),
            ({"policy.n_lstm_layers": 1000}, "n_lstm_layers = 1000 is out of range: it must be at most 100"),
            ({"policy.lstm_hidden_size": 10**5}, "more than 10000000 or 65536"),
            ({"policy.cells": 3}, "does not fit RecurrentPPO"),
            ({"algorithm": "PPO"}, "does not fit PPO.*lstm_hidden_size"),
            ({"teacher.window": 0}, "teacher.window = 0 is out of range"),
        ],
    )
    def test_a_configuration(self, values, words, tmp_path):
        text = config.with_values(TINY, values)
        with pytest.raises(ValueError, match=words):
            train.train(config.parse(text, "tiny"), text, tmp_path / "run", progress_bar=False)
        assert not (tmp_path / "run").exists()

    def test_an_lstm_of_another_form_is_not_exported(self, tmp_path):
        env = bb.BallbotVecEnv(4, num_threads=1)
        policy = {"lstm_kwargs": {"bias": False}, "lstm_hidden_size": 4}
        model = sb3_contrib.RecurrentPPO("MlpLstmPolicy", env, n_steps=8, batch_size=8, policy_kwargs=policy)
        bb.save(model, tmp_path / "p.zip")
        with pytest.raises(ValueError, match=r"lstm_kwargs\.bias = False cannot be exported"):
            export.export(tmp_path / "p.zip", tmp_path / "p.onnx")

    def test_without_the_library_the_extra_is_named(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "sb3_contrib", None)
        with pytest.raises(
            ModuleNotFoundError, match=r"algorithm = RecurrentPPO needs sb3_contrib: install it with .*train"
        ):
            train.train(config.parse(TINY, "tiny"), TINY, tmp_path / "run", progress_bar=False)
