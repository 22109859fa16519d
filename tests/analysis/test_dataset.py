"""Datasets have what the environment returned, episode by episode, in memory, in files and in Minari."""

import gymnasium
import numpy as np
import pytest

import ballbot_rs as bb

#: Some robots start beyond what LQR recovers from: their episodes are shorter.
STEEP = {"max_episode_steps": 60, "reset_tilt": 0.34, "max_wheel_torque": 0.1}
ARRAYS = ("observations", "actions", "rewards", "terminations", "truncations")


def test_each_episode_is_what_its_environment_returns():
    data = bb.record_dataset("lqr", episodes=8, noise=0.05, task="velocity", **STEEP, seed=3)
    assert len(data) == 8
    assert len(set(np.diff(data.starts))) > 1
    env = gymnasium.make(data.env_id, **data.env_options)
    for i, (first, last) in enumerate(zip(data.starts[:-1], data.starts[1:], strict=True)):
        observation, info = env.reset(seed=data.seed + i)
        for row in range(first, last):
            np.testing.assert_array_equal(data.observations[row], observation)
            assert {key: values[row] for key, values in data.infos.items()} == info
            if row == last - 1:
                break
            observation, reward, terminated, truncated, info = env.step(data.actions[row])
            assert (data.rewards[row], data.terminations[row], data.truncations[row]) == (reward, terminated, truncated)
        assert terminated or truncated
        assert not any(getattr(data, name)[last - 1].any() for name in ARRAYS[1:])


def test_actions_are_the_controller_and_the_noise():
    plain, noisy = (bb.record_dataset("lqr", episodes=4, noise=noise, **STEEP) for noise in (0.0, 0.2))
    lqr = bb.Lqr(max_torque=STEEP["max_wheel_torque"])
    env = bb.BalanceEnv(**STEEP)
    env.reset(seed=0)
    np.testing.assert_allclose(plain.actions[0], lqr(env.state) / STEEP["max_wheel_torque"], rtol=1e-6)
    first = noisy.actions[noisy.starts[:-1]] - plain.actions[plain.starts[:-1]]
    assert 0.0 < np.abs(first).max() < 1.0
    assert np.abs(noisy.actions).max() <= 1.0


def test_the_same_numbers_on_any_number_of_threads():
    one, two = (bb.record_dataset("lqr", episodes=9, **STEEP, num_threads=threads) for threads in (1, 2))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_the_file_has_all_arrays(tmp_path):
    data = bb.record_dataset("lqr", episodes=3, task="goal", **STEEP)
    data.to_npz(tmp_path / "data.npz")
    with np.load(tmp_path / "data.npz") as read:
        assert set(read) == {"starts", *ARRAYS, *(f"infos_{key}" for key in data.infos)}
        np.testing.assert_array_equal(read["observations"], data.observations)
    with pytest.raises(ValueError, match=r"must end in \.npz"):
        data.to_npz(tmp_path / "data.txt")
    steps = int(data.starts[-1]) - 3
    assert repr(data) == f"<Dataset of lqr in ballbot_rs:ballbot/Goal-v0: 3 episodes, {steps} steps>"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"episodes": 0}, "episodes = 0"),
        ({"noise": -0.1}, "noise = -0.1 is out of range"),
        ({"noise": float("nan")}, "noise = nan is out of range"),
        ({"seed": -1}, "seed = -1 is out of range"),
        ({"episodes": 1000, "max_episode_steps": 100_000}, "record fewer at a time"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.record_dataset("lqr", **arguments)


def test_minari_reads_the_episodes_back(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = bb.record_dataset("lqr", episodes=4, task="goal", **STEEP, seed=2)
    about = {"author": "me", "author_email": "me@example.org", "code_permalink": "none", "description": "LQR"}
    data.to_minari("ballbot/goal-lqr-v0", **about)
    read = minari.load_dataset("ballbot/goal-lqr-v0")
    assert (read.total_episodes, read.total_steps) == (4, len(data.rewards) - 4)
    for i, episode in enumerate(read.iterate_episodes()):
        rows = slice(data.starts[i], data.starts[i + 1])
        np.testing.assert_array_equal(episode.observations, data.observations[rows])
        np.testing.assert_array_equal(episode.actions, data.actions[rows][:-1])
        assert {key: values.tolist() for key, values in episode.infos.items()} == {
            key: values[rows].tolist() for key, values in data.infos.items()
        }
    env = read.recover_environment()
    np.testing.assert_array_equal(env.reset(seed=2)[0], data.observations[0])
    with pytest.raises(ValueError, match="already exists"):
        data.to_minari("ballbot/goal-lqr-v0", **about)


def test_without_minari_the_message_has_the_extra(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(ModuleNotFoundError, match=r"a dataset of Minari needs minari: install it with .*\[minari\]"):
        bb.record_dataset("lqr", episodes=1, **STEEP).to_minari("x-v0")
