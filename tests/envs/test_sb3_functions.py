"""`BallbotVecEnv` as `make_vec_env` makes it, against `DummyVecEnv`."""

import copy
import functools
import pickle

import gymnasium
import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor, load_results

import ballbot_rs as bb
from tests.support.names import BALANCE

OPTIONS = {"model": "spatial", "control_dt": 0.02, "robot": "kugle"}


def pair(tmp_path=None, **options):
    """The same environments from our class and from the class of Stable-Baselines3."""
    made = []
    for kind in (bb.BallbotVecEnv, None):
        folder = None if tmp_path is None else str(tmp_path / str(kind))
        made.append(
            make_vec_env(
                BALANCE,
                n_envs=3,
                seed=7,
                monitor_dir=folder,
                vec_env_cls=kind,
                env_kwargs={**OPTIONS, "max_episode_steps": 30, **options},
            )
        )
    return made


class NoTorque:
    def predict(self, observations, **_):
        return np.zeros((len(observations), 3)), None


def without_time(info):
    info = copy.deepcopy(info)
    if "episode" in info:
        assert info["episode"].pop("t") >= 0.0
    info.pop("terminal_observation", None)
    return info


def test_steps_and_episodes_match_a_dummy_vec_env(tmp_path):
    ours, theirs = pair(tmp_path)
    assert isinstance(ours, bb.BallbotVecEnv)
    assert (ours.num_envs, ours.control_dt, ours.model, ours.render_mode) == (3, 0.02, "spatial", "rgb_array")
    assert ours.params == bb.Params.preset("kugle")
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    rng, episodes = np.random.default_rng(0), 0
    for _ in range(100):
        actions = rng.uniform(-1.0, 1.0, (3, 3)).astype(np.float32)
        found, expected = ours.step(actions), theirs.step(actions)
        for our_array, their_array in zip(found[:3], expected[:3], strict=True):
            np.testing.assert_array_equal(our_array, their_array)
        for done, our_info, their_info in zip(found[2], found[3], expected[3], strict=True):
            if done:
                assert without_time(our_info) == without_time(their_info)
                episodes += 1
    assert episodes >= 9
    ours.close()
    theirs.close()
    logs = [load_results(str(tmp_path / str(kind))).drop(columns="t") for kind in (bb.BallbotVecEnv, None)]
    assert len(logs[0]) == episodes
    for column in ("r", "l"):
        assert sorted(logs[0][column]) == sorted(logs[1][column])


def test_evaluations_detect_the_monitor(recwarn):
    ours, theirs = pair()
    for index in (None, 1, [0, 2]):
        assert ours.env_is_wrapped(Monitor, index) == theirs.env_is_wrapped(Monitor, index)
    assert ours.env_is_wrapped(gymnasium.wrappers.ClipAction) == [False] * 3
    results = [evaluate_policy(NoTorque(), env, 6, return_episode_rewards=True, warn=True) for env in (ours, theirs)]
    assert results[0] == results[1]
    assert not [warning for warning in recwarn if "Monitor" in str(warning.message)]


def test_keywords_of_the_monitor_and_the_reset():
    env = make_vec_env(
        BALANCE,
        n_envs=2,
        vec_env_cls=bb.BallbotVecEnv,
        env_kwargs={"max_episode_steps": 5},
        monitor_kwargs={"info_keywords": ("is_success",)},
    )
    env.reset()
    for _ in range(3):
        env.step(np.zeros((2, 3)))
    env.reset()
    for _ in range(5):
        *_, infos = env.step(np.zeros((2, 3)))
    assert [info["episode"]["l"] for info in infos] == [5, 5]
    assert [info["episode"]["is_success"] for info in infos] == [False, False]
    with pytest.raises(ValueError, match=r"reset_keywords = \('level',\)"):
        bb.BallbotVecEnv([lambda: Monitor(bb.BalanceEnv(), reset_keywords=("level",))])


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_writes_no_files(tmp_path, duplicate):
    env = pair(tmp_path)[0]
    env.reset()
    twin = duplicate(env)
    for _ in range(40):
        found = twin.step(np.zeros((3, 3)))[3]
    assert found is not None
    twin.close()
    env.close()
    assert len(load_results(str(tmp_path / str(bb.BallbotVecEnv)))) == 0


def test_functions_without_a_monitor_and_with_a_separate_limit():
    env = bb.BallbotVecEnv([functools.partial(bb.GoalEnv, max_episode_steps=4)] * 2, num_threads=1, seed=3)
    assert (env.task, env.num_envs, env.task_options["max_episode_steps"]) == ("goal", 2, 4)
    twin = bb.BallbotVecEnv(2, task="goal", seed=3, max_episode_steps=4)
    np.testing.assert_array_equal(env.reset(), twin.reset())
    for _ in range(4):
        found = env.step(np.zeros((2, 3)))
        np.testing.assert_array_equal(found[0], twin.step(np.zeros((2, 3)))[0])
    assert all("episode" not in info for info in found[3])
    assert env.env_is_wrapped(Monitor) == [False, False]


@pytest.mark.parametrize(
    ("functions", "options", "error", "message"),
    [
        ([], {}, ValueError, "got no functions"),
        ([lambda: gymnasium.make("CartPole-v1")], {}, TypeError, "makes a CartPoleEnv, expected a BallbotEnv"),
        (
            [bb.BalanceEnv, functools.partial(bb.BalanceEnv, control_dt=0.02)],
            {},
            ValueError,
            r"functions 0 and 1 differ: control_dt = 0.01 and 0.02",
        ),
        (
            [lambda: gymnasium.wrappers.ClipAction(bb.BalanceEnv())],
            {},
            ValueError,
            "without the wrapper ClipAction of a function: wrap the BallbotVecEnv in a VecEnvWrapper",
        ),
        ([bb.BalanceEnv], {"task": "goal"}, TypeError, "got functions and task='goal'"),
        ([bb.BalanceEnv], {"control_dt": 0.02}, TypeError, "got functions and control_dt=0.02"),
    ],
)
def test_functions_that_a_batch_does_not_support_are_rejected(functions, options, error, message):
    with pytest.raises(error, match=message):
        bb.BallbotVecEnv(functions, **options)


def test_a_monitor_that_forbids_early_resets_does_so_here():
    def made(kind):
        return make_vec_env(BALANCE, n_envs=2, vec_env_cls=kind, monitor_kwargs={"allow_early_resets": False})

    for kind in (bb.BallbotVecEnv, None):
        envs = made(kind)
        envs.reset()
        envs.step(np.zeros((2, 3), dtype=np.float32))
        with pytest.raises(RuntimeError, match="early"):
            envs.reset()
        envs.close()


@pytest.mark.parametrize("wrong", [True, 2.0, 2.5, object(), {"n": 2}, [1, 2], lambda: None])
def test_arguments_of_wrong_types_are_rejected_by_name(wrong):
    with pytest.raises(
        TypeError, match="expected a number of robots, the name or id of a task, or a list of functions"
    ):
        bb.BallbotVecEnv(wrong)


def test_a_number_of_numpy_is_a_number():
    assert bb.BallbotVecEnv(np.int64(3)).num_envs == 3
