"""Policies that users train themselves with Stable-Baselines3: every command accepts them."""

import gymnasium
import numpy as np
import pytest
import stable_baselines3
from gymnasium.wrappers import FrameStackObservation, RescaleAction
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecFrameStack, VecMonitor, VecNormalize

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.control import sb3_policy
from ballbot_rs.control.resolve import find
from tests.support.names import BALANCE

OPTIONS = {"model": "spatial", "max_wheel_torque": 0.25}


def model_of(algorithm, env):
    small = {"net_arch": [8]}
    extra = {} if algorithm in ("PPO", "A2C") else {"buffer_size": 10}
    return getattr(stable_baselines3, algorithm)("MlpPolicy", env, policy_kwargs=small, seed=0, **extra)


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
def test_a_saved_policy_is_evaluated_and_exported_as_itself(algorithm, tmp_path):
    model = model_of(algorithm, bb.BallbotVecEnv(1, **OPTIONS))
    path = bb.save(model, tmp_path / "mine")
    assert path == tmp_path / "mine.zip"
    found = find(path)
    assert found.env_options == bb.BallbotVecEnv(1, **OPTIONS).task_options
    observations = np.random.default_rng(0).normal(size=(20, 16)).astype(np.float32)
    expected = model.predict(observations, deterministic=True)[0]
    np.testing.assert_array_equal(found.policy(observations), expected)
    assert main(["export", str(path), "-o", str(tmp_path / "mine.onnx")]) == 0
    np.testing.assert_allclose(bb.OnnxPolicy(tmp_path / "mine.onnx").act(observations), expected, atol=1e-5)
    one, other = bb.compare([path, tmp_path / "mine.onnx"], episodes=2)
    assert one.model == "spatial"
    assert one.tilt_rms == pytest.approx(other.tilt_rms, rel=1e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: VecMonitor(bb.BallbotVecEnv(2, **OPTIONS)),
        lambda: gymnasium.make(BALANCE, **OPTIONS),
        lambda: make_vec_env(BALANCE, n_envs=2, env_kwargs=OPTIONS),
        lambda: bb.BalanceEnv(**OPTIONS, robot=bb.Params.paper()),
    ],
)
def test_the_options_match_the_environment(make, tmp_path):
    options = find(bb.save(model_of("PPO", make()), tmp_path / "p.zip")).env_options
    assert options["max_wheel_torque"] == 0.25
    assert bb.BalanceEnv(**options).model == "spatial"
    assert bb.BalanceEnv(**options).params == bb.Params.paper()


def test_a_loaded_policy_keeps_its_metadata(tmp_path):
    path = bb.save(model_of("PPO", bb.BallbotVecEnv(1, **OPTIONS)), tmp_path / "a.zip")
    again = bb.save(PPO.load(path), tmp_path / "b.zip")
    assert find(again).env_options == find(path).env_options


def test_what_a_policy_file_cannot_hold_is_not_saved(tmp_path):
    env = bb.BallbotVecEnv(1, **OPTIONS)
    with pytest.raises(ValueError, match="VecNormalize's statistics"):
        bb.save(model_of("PPO", VecNormalize(env)), tmp_path / "x")
    single = gymnasium.make(BALANCE, **OPTIONS)
    with pytest.raises(ValueError, match=r"a wrapper has changed the spaces: .* \(3,\), float32\)$"):
        bb.save(model_of("PPO", RescaleAction(single, -2.0, 2.0)), tmp_path / "x")
    longer = bb.BallbotVecEnv(1, history=[0, 4], **OPTIONS)
    stacked = (VecFrameStack(env, 3), 3), (FrameStackObservation(single, 2), 2), (VecFrameStack(longer, 2), 4)
    for wrapped, count in stacked:
        with pytest.raises(ValueError, match=f"spaces: .* instead of a wrapper, the option history={count} of"):
            bb.save(model_of("PPO", wrapped), tmp_path / "x")
    with pytest.raises(ValueError, match="not from ballbot_rs"):
        bb.save(model_of("PPO", gymnasium.make("Pendulum-v1")), tmp_path / "x")
    model = model_of("PPO", env)
    model.save(tmp_path / "plain.zip")
    with pytest.raises(ValueError, match="no environment to take the task from"):
        bb.save(PPO.load(tmp_path / "plain.zip"), tmp_path / "x")
    assert [path.name for path in tmp_path.iterdir()] == ["plain.zip"]


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
def test_a_plain_file_is_accepted_once_its_task_is_named(algorithm, tmp_path, capsys):
    path = tmp_path / "plain.zip"
    model_of(algorithm, bb.BallbotVecEnv(1, **OPTIONS)).save(path)
    with pytest.raises(ValueError, match="does not name the environment it was trained on: name the task"):
        bb.evaluate(path)
    named = bb.evaluate(path, task="balance", episodes=2, **OPTIONS)
    saved = bb.evaluate(bb.save(model_of(algorithm, bb.BallbotVecEnv(1, **OPTIONS)), tmp_path / "s"), episodes=2)
    assert vars(named) == {**vars(saved), "controller": str(path)}
    option = ["--set", "max_wheel_torque=0.25", "--model", "spatial"]
    target = tmp_path / "plain.onnx"
    assert main(["evaluate", "--controller", str(path)]) == 1
    assert main(["evaluate", "balance", "--controller", str(path), "--episodes", "1"]) == 0
    assert main(["export", str(path), "-o", str(target)]) == 1
    assert main(["export", str(path), "-o", str(target), "--task", "balance", *option]) == 0
    assert bb.OnnxPolicy(target).metadata["max_wheel_torque"] == 0.25
    still = ["--no-video", "--still", "0", "--size", "32", "24", "--seconds", "0.1", "-o", str(tmp_path / "a.mp4")]
    assert main(["record", "--controller", str(path), *option, *still]) == 0
    figure = ["--figure", "phase_portrait", "--seconds", "0.1", "-o", str(tmp_path / "figures")]
    assert main(["plot", "balance", "--controller", str(path), *figure]) == 0
    capsys.readouterr()


def test_a_plain_file_of_another_task_is_rejected(tmp_path):
    model_of("PPO", gymnasium.make("Pendulum-v1")).save(tmp_path / "pendulum.zip")
    with pytest.raises(ValueError, match="trained for another environment: it has a space of shape"):
        bb.evaluate(tmp_path / "pendulum.zip", task="balance")


def test_algorithms_of_contrib_are_found_where_it_is_installed():
    pytest.importorskip("sb3_contrib")
    assert {"TQC", "TRPO"} <= set(sb3_policy.algorithms())
