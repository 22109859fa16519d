"""Pickled code in a policy file: it does not run, or the user is warned."""

import base64
import json
import pickle
import warnings
import zipfile

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy

import ballbot_rs as bb
from ballbot_rs.control import sb3_policy
from ballbot_rs.control.resolve import find
from tests.support.policies import edited_policy

OPTIONS = {"model": "spatial"}


class Dropper:
    """A pickle of it makes a file as it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (exec, (f"open({str(self.path)!r}, 'w').close()",))


class OwnPolicy(ActorCriticPolicy):
    """A policy class that does not belong to the algorithm."""


def pickled(value, **described):
    return {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(value)).decode(), **described}


def poisoned(source, target, name, trace):
    def edit(data):
        described = data[name] if isinstance(data.get(name), dict) else {}
        data[name] = {**described, **pickled(Dropper(trace))}

    return edited_policy(source, target, edit)


def pickled_names(path):
    with zipfile.ZipFile(path) as archive:
        data = json.loads(archive.read("data"))
    return [name for name, value in data.items() if isinstance(value, dict) and ":serialized:" in value]


def test_loading_a_policy_runs_no_code(tiny_run, tmp_path):
    source, trace = tiny_run / "best_model.zip", tmp_path / "trace"
    names = pickled_names(source)
    assert {"policy_class", "observation_space", "learning_rate"} <= set(names)
    observations = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    expected = PPO.load(source).predict(observations, deterministic=True)[0]
    for name in names:
        path = poisoned(source, tmp_path / f"{name}.zip", name, trace)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = find(path)
        np.testing.assert_array_equal(found.policy(observations), expected)
        assert not trace.exists(), name
    with pytest.raises(ValueError, match="NoneType"):
        PPO.load(poisoned(source, tmp_path / "x.zip", "observation_space", trace))
    assert trace.exists(), "the poison does nothing, so this test shows nothing"


def test_layers_and_optimizers_of_torch_are_not_code(tmp_path):
    arguments = {"net_arch": [8], "activation_fn": torch.nn.ReLU, "optimizer_class": torch.optim.RMSprop}
    model = PPO("MlpPolicy", bb.BallbotVecEnv(1, **OPTIONS), policy_kwargs=arguments, seed=0)
    path = bb.save(model, tmp_path / "relu")
    assert "policy_kwargs" in pickled_names(path)
    observations = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = find(path)
    np.testing.assert_array_equal(found.policy(observations), model.predict(observations, deterministic=True)[0])


def test_code_in_the_arguments_of_a_policy_gives_a_warning(tiny_run, tmp_path):
    trace = tmp_path / "trace"
    path = poisoned(tiny_run / "best_model.zip", tmp_path / "p.zip", "policy_kwargs", trace)
    with (
        pytest.warns(UserWarning, match=r"p\.zip has custom policy_kwargs: loading it runs code"),
        pytest.raises(ValueError, match="holds no PPO policy"),
    ):
        find(path)


def test_a_third_party_policy_class_gives_a_warning(tmp_path):
    path = bb.save(PPO(OwnPolicy, bb.BallbotVecEnv(1, **OPTIONS), seed=0), tmp_path / "own")
    with pytest.warns(UserWarning, match=r"own\.zip has custom policy_class: loading it runs code") as caught:
        model, _ = sb3_policy.load(path, "balance")
    assert len(caught) == 1
    assert type(model.policy).__name__ == "OwnPolicy"


def test_files_are_rejected_before_their_code_runs(tiny_run, tmp_path):
    trace = tmp_path / "trace"
    source = poisoned(tiny_run / "best_model.zip", tmp_path / "source.zip", "policy_class", trace)

    def of(edit):
        return edited_policy(source, tmp_path / "edited.zip", edit)

    def foreign(data):
        data.pop("ballbot_metadata")
        data["observation_space"]["_shape"] = [3]

    def huge(data):
        data["policy_kwargs"] = {"net_arch": [100_000, 100_000]}

    for edit, message in (
        (lambda data: data["ballbot_metadata"].update(env_id="ballbot/Walk-v0"), "another environment"),
        (lambda data: data["ballbot_metadata"].update(algorithm="SAC"), "holds no SAC policy"),
        (foreign, r"has a space of shape \[3\]"),
        (huge, r"net_arch = \[100000, 100000\] has 10001600000 weights, more than 10000000"),
    ):
        with pytest.raises(ValueError, match=message):
            find(of(edit), task="balance")
    whole = source.read_bytes()
    for length in (10, len(whole) // 2, len(whole) - 30):
        (tmp_path / "cut.zip").write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"cut\.zip is not a policy file of Stable-Baselines3: "):
            find(tmp_path / "cut.zip")
    broken = bytearray(whole)
    with zipfile.ZipFile(source) as archive:
        broken[archive.getinfo("policy.pth").header_offset + 200] ^= 0xFF
    (tmp_path / "broken.zip").write_bytes(broken)
    with pytest.raises(ValueError, match=r"'policy\.pth' in it is damaged"):
        find(tmp_path / "broken.zip")
    assert not trace.exists()
