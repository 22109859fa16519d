"""What the three front ends have in common, and where they follow Gymnasium."""

import json
import os
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

import ballbot_rs as bb
from tests.support.names import BALANCE

OPTIONS = {"model": "spatial", "control_dt": 0.02, "max_wheel_torque": 0.5}
SHARED = ("params", "model", "sim_dt", "control_dt", "max_wheel_torque", "task", "task_options")


def front_ends(**options):
    single, vector, sb3 = (
        bb.BalanceEnv(**options),
        bb.BalanceVectorEnv(2, **options),
        bb.BallbotVecEnv(2, **options),
    )
    for env, arguments in ((single, {"seed": 0}), (vector, {"seed": 0}), (sb3, {})):
        env.reset(**arguments)
    return single, vector, sb3


@pytest.mark.parametrize("name", SHARED)
def test_attributes_are_the_same_on_all_front_ends(name):
    single, vector, sb3 = front_ends(**OPTIONS)
    expected = getattr(single, name)
    assert getattr(vector, name) == getattr(sb3, name) == expected
    assert vector.get_attr(name) == (expected, expected)
    assert sb3.get_attr(name) == [expected, expected]
    if name in OPTIONS:
        assert expected == OPTIONS[name]


def test_states_and_pushes():
    single, vector, sb3 = front_ends(**OPTIONS)
    assert single.unwrapped is single
    assert vector.unwrapped is vector
    assert [view.unwrapped is view for view in sb3.get_attr("unwrapped")] == [True, True]
    for many in (vector, sb3):
        before = many.states
        np.testing.assert_array_equal(before[1], many.get_attr("state")[1].to_array())
        many.push([0.5, 0.0, 0.0], index=1)
        np.testing.assert_array_equal(many.states[0], before[0])
        assert many.states[1, 20] > before[1, 20]
        many.push([0.5, 0.0, 0.0])
        assert many.states[0, 20] > before[0, 20]
    before = single.state.body_velocity[0]
    single.push([0.5, 0.0, 0.0])
    assert single.state.body_velocity[0] > before


def test_episodes_without_a_time_limit():
    for env in front_ends(max_episode_steps=None, model="spatial"):
        assert env.task_options["max_episode_steps"] is None
    env = gymnasium.make_vec(BALANCE, num_envs=1, max_episode_steps=None)
    assert env.unwrapped.task_options["max_episode_steps"] is None


def test_parameters_may_be_a_dict():
    params = bb.Params.preset("kugle")
    for env in front_ends(robot=params.to_dict(), max_wheel_torque=1.0):
        assert env.params == params


def test_frames_of_a_chosen_size():
    for env in front_ends(render_mode="rgb_array", width=32, height=24, camera={"distance": 1.0}):
        frames = env.get_images() if isinstance(env, bb.BallbotVecEnv) else env.render()
        assert np.shape(frames)[-3:] == (24, 32, 3)


def test_rewards_are_float64_as_gymnasiums():
    single, vector, _ = front_ends(**OPTIONS)
    rewards = vector.step(np.zeros((2, 3)))[1]
    assert rewards.dtype == np.float64
    assert rewards[0] == single.step(np.zeros(3))[1]


def test_seeds_of_the_vector_environment_are_a_tuple():
    env = bb.BalanceVectorEnv(3, seed=5)
    assert env.np_random_seed == (5, 6, 7)
    env.reset(seed=30)
    assert env.np_random_seed == (30, 31, 32)
    env.reset(seed=[1, None, 3])
    assert env.np_random_seed == (1, 31, 3)
    env.reset(seed=[7, 8, 9], options={"reset_mask": np.array([True, False, False])})
    assert env.np_random_seed == (7, 31, 3)


def test_spaces_by_get_attr_match_a_single_environment():
    env = bb.BalanceVectorEnv(2)
    assert env.get_attr("action_space") == (env.single_action_space,) * 2
    assert env.get_attr("observation_space")[0].shape == (16,)
    assert env.call("action_space") == env.get_attr("action_space")


@pytest.mark.parametrize("limit", [5, 1000])
def test_success_is_reported_at_every_step_and_limit(balance, limit):
    made = {} if limit == 1000 else {"max_episode_steps": limit}
    env = gymnasium.make(BALANCE, model="spatial", **made)
    direct = bb.BalanceEnv(model="spatial", max_episode_steps=limit)
    env.reset(seed=0)
    direct.reset(seed=0)
    for _ in range(limit):
        action = balance(direct.state)
        found, expected = env.step(action), direct.step(action)
        assert found[1:4] == expected[1:4]
        assert found[4] == expected[4]
        assert found[4]["is_success"] == env.unwrapped.is_success == direct.is_success
    assert found[3]
    assert found[4]["is_success"] == (limit == 1000)
    _, info = env.reset()
    assert info == {"is_success": False, "termination": 0}


def test_a_view_has_what_wrappers_of_gymnasium_use():
    env = bb.BallbotVecEnv(2, **OPTIONS, seed=3)
    spec = env.get_attr("spec")[0]
    made = gymnasium.make(spec)
    assert made.unwrapped.control_dt == 0.02
    assert spec.max_episode_steps == 1000
    assert env.get_attr("metadata")[0]["render_fps"] == 50
    assert [rng.random() for rng in env.get_attr("np_random")] == [np.random.default_rng(s).random() for s in (3, 4)]
    assert env.env_method("set_wrapper_attr", "label", "x") == [True, True]
    assert env.env_method("get_wrapper_attr", "label") == ["x", "x"]
    assert env.env_method("has_wrapper_attr", "other", indices=0) == [False]
    assert env.env_method("set_wrapper_attr", "other", 1, force=False) == [False, False]
    with pytest.raises(AttributeError, match="reward is fixed"):
        env.env_method("set_wrapper_attr", "reward", {})


@pytest.mark.slow("processes")
@pytest.mark.parametrize(
    ("variable", "argument", "expected"), [(None, "", 1), (None, ", torch_threads=None", 2), ("2", "", 2)]
)
def test_torch_has_one_thread_by_default(variable, argument, expected):
    code = f"""
import torch
torch.set_num_threads(2)
import ballbot_rs
ballbot_rs.BallbotVecEnv(1{argument})
print(torch.get_num_threads())
"""
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    if variable is not None:
        environment["OMP_NUM_THREADS"] = variable
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300, check=True
    )
    assert int(done.stdout) == expected
    assert torch.get_num_threads() == 1


def test_a_frame_shows_the_present_parameters() -> None:
    env = bb.BalanceEnv(render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    env.set_params("kugle")
    start = bb.State.at_rest(env.params, tilt=(0.05, 0.0))
    env.reset(options={"state": start})
    other = bb.BalanceEnv(robot="kugle", render_mode="rgb_array", width=64, height=48)
    other.reset(options={"state": start})
    np.testing.assert_array_equal(env.render(), other.render())


def test_results_of_an_episode_end_with_its_reset() -> None:
    batch = bb.Batch(1, model="spatial", autoreset="disabled", fall_tilt=0.1, reset_tilt=0.05, max_wheel_torque=1.0)
    batch.reset(seeds=[0])
    while not batch.step([[1.0, -1.0, 0.5]])[2][0]:
        pass
    assert batch.ending(0) == (False, "tilt")
    batch.reset()
    assert batch.ending(0) == (False, None)
    assert batch.infos() == [{"TimeLimit.truncated": False, "is_success": False, "termination": 0}]


def test_a_snapshot_of_other_options_is_rejected() -> None:
    raw = bb.Batch(1, model="contact", scale_observations=False)
    raw.reset()
    scaled = bb.Batch(1, model="contact")
    scaled.reset()
    before = scaled.observations().copy()
    with pytest.raises(bb.InvalidInputError, match="options of its task differ"):
        scaled.restore(0, raw.snapshot(0))
    np.testing.assert_array_equal(scaled.observations(), before)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda b: b.rollout(bb.Lqr(), -1), "steps = -1"),
        (lambda _: bb.Batch(-1), "num_envs = -1"),
        (lambda b: b.rollout(bb.Lqr(), 1, {"position": [1.7e308, 0.0]}), "setpoint position = 1"),
        (lambda _: bb.Batch(1, scale_observations=0.5), "scale_observations = 0.5"),
        (lambda _: bb.Batch(1, max_episode_steps=1e300), "max_episode_steps = 1"),
        (lambda b: bb.Lqr().deviation(b.state(0), yaw=float("nan")), "setpoint yaw = NaN"),
    ],
)
def test_bad_input_of_batches_names_value_and_limit(call, message: str) -> None:
    batch = bb.Batch(2, model="contact")
    batch.reset()
    with pytest.raises(bb.InvalidInputError, match=message):
        call(batch)


def test_a_record_beyond_memory_is_rejected() -> None:
    batch = bb.Batch(2, model="contact")
    batch.reset()
    with pytest.raises(MemoryError, match="record 'states' of shape"):
        batch.rollout(bb.Lqr(), 2**60)


def test_lqr_accepts_a_cost_once() -> None:
    with pytest.raises(TypeError, match="R or the weight torque"):
        bb.Lqr(R=np.eye(3), torque=0.1)
    with pytest.raises(TypeError, match="Q or the weight tilt"):
        bb.Lqr(Q=np.eye(10), tilt=0.1)
    assert bb.Lqr(Q=np.eye(10), torque=0.1).gain.shape == (3, 10)


def test_files_are_read_once(tmp_path):
    file = tmp_path / "mine.toml"
    mine = bb.Params.preset("kugle").replace(body_mass=11.0)
    file.write_text("".join(f"{name} = {json.dumps(value)}\n" for name, value in mine.to_dict().items()))
    tables = {
        "actuators": "[actuators]\ndelay = 0.004\n",
        "sensors": "[sensors]\ngyro_noise = 0.01\n",
        "events": '[[events]]\nterm = "body_mass"\nop = "scale"\nrange = [0.9, 1.1]\n',
    }
    for name, text in tables.items():
        (tmp_path / f"{name}.toml").write_text(text)
    files = {name: tmp_path / f"{name}.toml" for name in tables}
    envs = front_ends(robot=str(file), **files)
    several = bb.BallbotVecEnv(16, robot=[file, "kugle"])
    learned = bb.save(PPO("MlpPolicy", envs[2], n_steps=8, batch_size=16), tmp_path / "policy.zip")
    for path in (file, *files.values()):
        path.unlink()
    for env in envs:
        assert env.task_options["robot"] == mine.to_dict()
        again = pickle.loads(pickle.dumps(env))
        assert again.task_options == env.task_options
    assert pickle.loads(pickle.dumps(several)).task_options["robot"] == [mine.to_dict(), "kugle"]
    assert bb.evaluate(learned, episodes=1).episodes == 1
