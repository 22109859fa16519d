"""Properties of every task of the core in every front end."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from tests.support.surface import class_name

ALL = sorted(TASKS)
COMMANDED = [task for task in ALL if TASKS[task]["command"]]
MODES = ("same_step", "next_step", "disabled")
SHORT = {"model": "contact", "max_episode_steps": 40}


def actions(step, n=5):
    return 0.3 * np.sin(np.arange(3 * n).reshape(n, 3) * 7 + 3 * step).astype(np.float32)


@pytest.mark.parametrize("task", ALL)
def test_gymnasium_checks_the_environment(task):
    env = gymnasium.make(TASKS[task]["id"], model="contact")
    check_env(env.unwrapped, skip_render_check=True)
    assert env.spec.max_episode_steps == TASKS[task]["max_episode_steps"]
    assert env.observation_space.shape == (len(TASKS[task]["observation"]),)
    named = getattr(bb, f"{class_name(task)}Env")(model="contact")
    assert type(env.unwrapped) is type(named)
    vector = gymnasium.make_vec(TASKS[task]["id"], num_envs=2, model="contact")
    assert type(vector) is getattr(bb, f"{class_name(task)}VectorEnv")
    first, again = env.reset(seed=3)[0], named.reset(seed=3)[0]
    np.testing.assert_array_equal(first, again)


@pytest.mark.slow("all tasks in all front ends")
@pytest.mark.parametrize("task", ALL)
@pytest.mark.parametrize("mode", MODES)
def test_front_ends_agree_and_pickles_continue(task, mode):
    """A single robot, the vector environment and its pickle are bit-identical, ends of episodes included."""
    n = 5
    vector = gymnasium.make_vec(TASKS[task]["id"], num_envs=n, autoreset_mode=mode, **SHORT).unwrapped
    singles = [bb.BallbotEnv(task, **SHORT) for _ in range(n)]
    seen, _ = vector.reset(seed=11)
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=11 + i)[0], seen[i])
    over = np.zeros(n, dtype=bool)
    ends = 0
    for step in range(100):
        if step == 30:
            vector = pickle.loads(pickle.dumps(vector))
        given = actions(step)
        if mode == "disabled" and over.any():
            observations, _ = vector.reset(options={"reset_mask": over})
            for i in np.flatnonzero(over):
                np.testing.assert_array_equal(singles[i].reset()[0], observations[i])
            over[:] = False
        observations, rewards, terminated, truncated, infos = vector.step(given)
        for i, single in enumerate(singles):
            if over[i]:
                np.testing.assert_array_equal(single.reset()[0], observations[i])
                over[i] = False
                continue
            expected, reward, is_terminated, is_truncated, info = single.step(given[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, is_terminated, is_truncated)
            done = is_terminated or is_truncated
            if done:
                ends += 1
                final = infos["final_info"] if mode == "same_step" else infos
                assert {name: final[name][i] for name in info} == info
            if done and mode == "same_step":
                np.testing.assert_array_equal(infos["final_obs"][i], expected)
                expected = single.reset()[0]
            else:
                over[i] = done
            np.testing.assert_array_equal(expected, observations[i])
    assert ends >= n


@pytest.mark.parametrize("task", ALL)
def test_stable_baselines3_gets_the_same(task):
    pytest.importorskip("stable_baselines3")
    n = 4
    env = bb.BallbotVecEnv(TASKS[task]["id"], num_envs=n, seed=6, **SHORT)
    assert env.task == task
    assert env.unwrapped is env
    batch = bb.Batch(n, task, seed=6, **SHORT)
    np.testing.assert_array_equal(env.reset(), batch.reset())
    ended = 0
    for step in range(60):
        given = actions(step, n)
        observations, rewards, dones, infos = env.step(given)
        expected = batch.step(given)
        np.testing.assert_array_equal(observations, expected[0])
        np.testing.assert_array_equal(rewards, expected[1].astype(np.float32))
        for i in np.flatnonzero(dones):
            ended += 1
            assert infos[i]["TimeLimit.truncated"] == expected[3][i]
            assert np.isfinite([infos[i][metric["name"]] for metric in TASKS[task]["metrics"]]).all()
    assert ended >= n


@pytest.mark.parametrize("task", COMMANDED)
def test_commands_are_set_by_hand_on_every_front_end(task):
    parts = len(TASKS[task]["command"])
    command = np.full(parts, 0.01) + 0.02 * np.arange(parts)
    # Slow enough for the sharp turns of a path with these coefficients.
    command[0] = 1e-4
    single = bb.BallbotEnv(task, model="contact")
    single.reset(seed=0)
    before, _ = single.reset(seed=0)
    single.command = command
    np.testing.assert_allclose(single.command, command)
    shown = single._batch.observations()[0]
    assert not np.allclose(before, shown)
    np.testing.assert_array_equal(shown[:9], before[:9])
    single.step(np.zeros(3))
    np.testing.assert_allclose(single.command, command)

    vector = bb.BallbotVectorEnv(3, task=task, model="contact")
    vector.reset(seed=0)
    vector.command = command
    np.testing.assert_allclose(vector.command, np.tile(command, (3, 1)))
    vector.set_attr("command", command * np.array([[1.0], [2.0], [3.0]]))
    np.testing.assert_allclose(vector.command[2], 3.0 * command, rtol=1e-6)
    np.testing.assert_allclose(vector.get_attr("command"), vector.command)
    before = vector.command
    with pytest.raises(ValueError, match="within"):
        vector.command = np.vstack([before[1:], np.full(parts, 1e6)])
    np.testing.assert_allclose(vector.command, before)

    pytest.importorskip("stable_baselines3")
    sb3 = bb.BallbotVecEnv(task, num_envs=3, model="contact")
    sb3.reset()
    sb3.set_attr("command", command, indices=[1])
    np.testing.assert_allclose(sb3.get_attr("command", indices=[1])[0], command)


@pytest.mark.parametrize("task", COMMANDED)
def test_wrong_commands_are_rejected(task):
    env = bb.BallbotEnv(task, model="contact")
    env.reset(seed=0)
    parts = len(TASKS[task]["command"])
    with pytest.raises(ValueError, match="command"):
        env.command = np.zeros(parts + 1)
    with pytest.raises(ValueError, match="within"):
        env.command = np.full(parts, 1e6)
    with pytest.raises(ValueError, match="command"):
        env.command = np.full(parts, np.nan)
    for plain in (bb.BallbotEnv("balance"), bb.BallbotVectorEnv(2)):
        with pytest.raises(ValueError, match="the task balance has no command"):
            plain.command = [0.0]
    with pytest.raises(ValueError, match="before the first reset"):
        bb.BallbotEnv(task).command = np.zeros(parts)
    vector = bb.BallbotVectorEnv(2, task=task, model="contact")
    with pytest.raises(ValueError, match=rf"expected \({parts},\) or \(2, {parts}\)"):
        vector.command = np.zeros((3, parts))


@pytest.mark.parametrize("task", ALL)
def test_a_regulator_does_the_task(task):
    """LQR with the task's setpoints, in the core and as a law in Python, gets the same metrics."""
    options = {"model": "contact", "max_episode_steps": 500}
    if TASKS[task]["has_terrain"]:
        options["terrain"] = {"kind": "plane", "slope": 0.05}
    found = bb.compare(["lqr"], task=task, episodes=6, seed=2, **options)[0]
    params = bb.Params.paper()
    lqr = bb.Controller("lqr", params, 0.01)

    class Law:
        batched = False

        def __call__(self, state, setpoint):
            return lqr(state, **dict(setpoint))

    assert found.survival_rate == 1.0
    assert set(found.metrics) == {metric["name"] for metric in TASKS[task]["metrics"]}
    by_hand = bb.compare([Law()], task=task, episodes=6, seed=2, **options)[0]
    for name, value in found.metrics.items():
        if value is not None:
            assert by_hand.metrics[name] == pytest.approx(value, rel=0.02, abs=1e-3)


@pytest.mark.parametrize("task", ALL)
def test_setpoints_of_all_are_the_setpoints_of_each(task):
    batch = bb.Batch(3, task, seed=4, num_threads=1)
    batch.reset()
    for part, rows in batch.setpoint().items():
        np.testing.assert_array_equal(rows, [batch.setpoint(i)[part] for i in range(3)])
