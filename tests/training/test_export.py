"""ONNX policies: equal to their source, honest about what they are for, and free of torch."""

import json
import re
import subprocess
import sys

import numpy as np
import onnx
import pytest
from stable_baselines3 import PPO, SAC

import ballbot_rs as bb
from ballbot_rs.analysis.episodes import compare
from ballbot_rs.cli import main
from ballbot_rs.control.onnx_policy import PREFIX, OnnxPolicy
from ballbot_rs.control.sb3_policy import METADATA, metadata
from ballbot_rs.training import export
from tests.support.names import BALANCE
from tests.support.paths import ROOT


@pytest.fixture(scope="module")
def exported(tiny_run, tmp_path_factory):
    path = tmp_path_factory.mktemp("exported") / "policy.onnx"
    assert export.export(tiny_run, path) <= export.TOLERANCE
    return path


@pytest.fixture
def observations():
    rng = np.random.default_rng(1)
    return rng.uniform(-10.0, 10.0, (1000, 16)).astype(np.float32)


def test_an_exported_policy_acts_as_its_source(exported, tiny_run, observations):
    policy = OnnxPolicy(exported)
    expected = PPO.load(tiny_run / "best_model.zip").predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
    one = policy.act(observations[7])
    assert one.shape == (3,)
    assert one.dtype == np.float32
    np.testing.assert_allclose(one, expected[7], atol=1e-5)


def test_actions_are_clipped_as_in_the_source(tiny_run, tmp_path, observations):
    # A policy trained for a second hardly acts; this policy exceeds its limits.
    model = PPO.load(tiny_run / "best_model.zip")
    model.policy.action_net.weight.data *= 200.0
    model.save(tmp_path / "wild.zip")
    export.export(tmp_path / "wild.zip", tmp_path / "wild.onnx")
    actions = OnnxPolicy(tmp_path / "wild.onnx").act(observations)
    assert 0.05 < (np.abs(actions) == 1.0).mean() < 0.95
    np.testing.assert_allclose(actions, model.predict(observations, deterministic=True)[0], atol=1e-5)


def test_a_policy_of_sac_is_exported_too(tmp_path, observations):
    model = SAC(
        "MlpPolicy",
        bb.BallbotVecEnv(num_envs=1, model="planar"),
        policy_kwargs={"net_arch": [8]},
        buffer_size=10,
    )
    setattr(model, METADATA, metadata("balance", "SAC", {"model": "planar", "scale_observations": True}))
    model.save(tmp_path / "sac.zip")
    export.export(tmp_path / "sac.zip", tmp_path / "sac.onnx")
    expected = model.predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(OnnxPolicy(tmp_path / "sac.onnx").act(observations), expected, atol=1e-5)


def test_metadata_state_the_purpose_and_nothing_of_this_machine(exported):
    policy = OnnxPolicy(exported)
    assert policy.env_options == bb.BallbotVecEnv(1, model="spatial", max_episode_steps=60).task_options
    assert policy.metadata["env_id"] == BALANCE
    assert policy.metadata["max_wheel_torque"] == policy.env_options["max_wheel_torque"] < 1.0
    assert policy.metadata["control_dt"] == 0.01
    assert policy.metadata["observation"][2] == ["gravity direction, body z", "", 1.0, -1.0, 0.1]
    assert policy.metadata["versions"]["ballbot_rs"] == bb.__version__
    content = exported.read_bytes()
    assert not re.search(rb"site-packages|/home/|/tmp/|\.py\b", content)


def test_policies_are_compared_whatever_their_file(exported, tiny_run):
    first, second = compare([str(exported), str(tiny_run)], episodes=3)
    assert first.mean_reward == pytest.approx(second.mean_reward, abs=1e-4)
    assert first.model == "spatial"


def edited(source, target, edit):
    proto = onnx.load(source)
    fields = {prop.key: prop.value for prop in proto.metadata_props}
    edit(fields)
    del proto.metadata_props[:]
    for key, value in fields.items():
        proto.metadata_props.add(key=key, value=value)
    onnx.save(proto, target)
    return target


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            lambda f: f.update({PREFIX + "env_id": '"ballbot/Walk-v0"'}),
            "env_id is 'ballbot/Walk-v0', expected one of ballbot/Balance-v0",
        ),
        (lambda f: f.update({PREFIX + "observation": '["tilt"]'}), r"observation is \['tilt'\], expected"),
        (lambda f: f.pop(PREFIX + "env_options"), "does not name its env_options"),
        (lambda f: f.update({PREFIX + "env_options": "[1]"}), r"env_options is \[1\], not a dict"),
        (lambda f: f.update({PREFIX + "control_dt": "fast"}), "does not name its control_dt"),
        (lambda f: f.clear(), "does not name its env_id"),
    ],
)
def test_a_policy_for_something_else_is_rejected(exported, tmp_path, edit, message):
    path = edited(exported, tmp_path / "edited.onnx", edit)
    with pytest.raises(ValueError, match=message) as caught:
        compare([str(path)], episodes=1)
    assert str(path) in str(caught.value)


def test_a_policy_from_before_scaling_acts_on_what_it_was_trained_on(exported, tmp_path):
    def old(fields):
        rows = json.loads(fields[PREFIX + "observation"])
        fields[PREFIX + "observation"] = json.dumps([row[:3] for row in rows])
        fields[PREFIX + "env_options"] = json.dumps({"model": "spatial"})

    policy = OnnxPolicy(edited(exported, tmp_path / "old.onnx", old))
    assert policy.env_options["scale_observations"] is False
    assert policy.env_options["max_wheel_torque"] == 1.0
    assert OnnxPolicy(exported).env_options["scale_observations"] is True


def test_files_that_are_not_policies_are_rejected(exported, tmp_path):
    (tmp_path / "cut.onnx").write_bytes(exported.read_bytes()[:500])
    with pytest.raises(ValueError, match=r"cut\.onnx is not an ONNX file"):
        OnnxPolicy(tmp_path / "cut.onnx")
    with pytest.raises(FileNotFoundError, match="no policy at"):
        OnnxPolicy(tmp_path / "nowhere.onnx")


@pytest.mark.parametrize("shape", [(15,), (4, 17), (2, 2, 16), ()])
def test_observations_of_another_shape_are_rejected(exported, shape):
    with pytest.raises(ValueError, match="observation has shape"):
        OnnxPolicy(exported).act(np.zeros(shape))


def test_a_policy_that_acts_differently_is_not_written(tiny_run, tmp_path, monkeypatch):
    monkeypatch.setattr(OnnxPolicy, "act", lambda _, rows: np.full((len(rows), 3), 2.0, np.float32))
    with pytest.raises(ValueError, match="and its ONNX form differ by"):
        export.export(tiny_run, tmp_path / "policy.onnx")
    assert list(tmp_path.iterdir()) == []


def test_the_command_and_its_mistakes(tiny_run, tmp_path, capsys):
    assert main(["export", str(tiny_run), "-o", str(tmp_path / "p.onnx"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["metadata"] == OnnxPolicy(report["policy"]).metadata
    assert main(["export", str(tiny_run), "-o", str(tmp_path / "p.zip")]) == 1
    assert "must end in .onnx" in capsys.readouterr().err


@pytest.mark.slow("a process")
def test_the_policy_in_the_box_balances_without_torch():
    code = """
import sys
sys.modules["torch"] = sys.modules["stable_baselines3"] = None
from ballbot_rs.analysis.episodes import evaluate
for model in ("contact", "rigid"):
    print(evaluate("assets/policies/balance.onnx", episodes=20, model=model).success_rate)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.split() == ["1.0", "1.0"]
    assert (ROOT / "assets/policies/balance.onnx").stat().st_size < 50_000
