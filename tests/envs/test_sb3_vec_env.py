"""`BallbotVecEnv` against the contract of Stable-Baselines3's `VecEnv`."""

import copy
import gc
import multiprocessing
import pickle
import weakref

import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from ballbot_rs import BalanceEnv, BalanceVectorEnv, BallbotVecEnv, Params, State
from tests.support.names import BALANCE

#: Falls and truncations both happen within the steps that the tests take.
SHORT = {"model": "spatial", "max_episode_steps": 45}

#: The info of a step within an episode that is not yet a success.
UNDERWAY = {"TimeLimit.truncated": False, "is_success": False, "termination": 0}


def actions_of(num_envs, steps, seed=0, scale=0.3):
    return np.random.default_rng(seed).uniform(-scale, scale, (steps, num_envs, 3)).astype(np.float32)


def assert_same_step(found, expected):
    for ours, theirs in zip(found[:3], expected[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for ours, theirs in zip(found[3], expected[3], strict=True):
        assert set(ours) == set(theirs)
        for key, value in theirs.items():
            np.testing.assert_array_equal(ours[key], value)


def test_attributes_that_learners_read():
    env = BallbotVecEnv(3, control_dt=0.02)
    assert isinstance(env, VecEnv)
    assert env.num_envs == 3
    assert env.observation_space.shape == (16,)
    assert env.action_space.shape == (3,)
    assert env.render_mode is None
    assert env.metadata["render_fps"] == 50
    assert env.reset_infos == [{}, {}, {}]
    assert env.unwrapped is env
    assert env.get_images() == [None, None, None]
    env.close()


def test_types_and_shapes_of_a_step():
    env = BallbotVecEnv(num_envs=2, seed=0)
    observations = env.reset()
    assert (observations.shape, observations.dtype) == ((2, 16), np.float32)
    observations, rewards, dones, infos = env.step(np.zeros((2, 3), dtype=np.float32))
    assert (observations.shape, observations.dtype) == ((2, 16), np.float32)
    assert (rewards.shape, rewards.dtype) == ((2,), np.float32)
    assert (dones.shape, dones.dtype) == ((2,), np.bool_)
    assert infos == [UNDERWAY] * 2
    assert env.reset_infos == [UNDERWAY] * 2


def test_equals_a_dummy_vec_env_of_single_environments():
    """The reference is SB3's own vectorization of `BalanceEnv`, over falls, truncations and resets."""
    n = 4
    fast = BallbotVecEnv(num_envs=n, num_threads=2, **SHORT)
    slow = DummyVecEnv([lambda: BalanceEnv(**SHORT)] * n)
    fast.seed(17)
    slow.seed(17)
    np.testing.assert_array_equal(fast.reset(), slow.reset())
    reasons = set()
    for actions in actions_of(n, 200, scale=0.3):
        observations, rewards, dones, infos = fast.step(actions)
        expected = slow.step(actions)
        np.testing.assert_array_equal(observations, expected[0])
        np.testing.assert_array_equal(rewards, expected[1])
        np.testing.assert_array_equal(dones, expected[2])
        for done, ours, theirs in zip(dones, infos, expected[3], strict=True):
            assert set(ours) == set(theirs)
            if not done:
                assert ours == theirs
                continue
            np.testing.assert_array_equal(ours.pop("terminal_observation"), theirs.pop("terminal_observation"))
            assert ours == theirs
            reasons.add(fast.metadata["terminations"][ours["termination"]])
    assert reasons == {"tilt", "none"}


def test_an_info_that_is_held_or_written_into_does_not_come_back():
    env = BallbotVecEnv(num_envs=4, model="contact", seed=0)
    env.reset()
    actions = np.zeros((4, 3), dtype=np.float32)
    held, alias = [], None
    for step in range(12):
        *_, infos = env.step(actions)
        assert infos == [UNDERWAY] * 4
        assert len({id(info) for info in infos}) == 4
        assert not {id(info) for info in infos} & {id(info) for info in held}
        if alias is not None:
            assert infos[1] is not alias
            assert alias == {**UNDERWAY, "mine": step - 1}
        held.append(infos[0])
        infos[1]["mine"] = step
        infos[2]["nobody holds it"] = step
        infos[3]["TimeLimit.truncated"] = infos[3]["is_success"] = True
        del infos[3]["termination"]
        alias = infos[1]


def test_an_environment_that_an_info_refers_to_is_collected():
    env = BallbotVecEnv(num_envs=2, model="contact", seed=0)
    env.reset()
    *_, infos = env.step(np.zeros((2, 3), dtype=np.float32))
    infos[0]["env"] = env
    gone = weakref.ref(env)
    del env, infos
    gc.collect()
    assert gone() is None


def test_infos_of_a_list_that_is_held_do_not_come_back():
    env = BallbotVecEnv(num_envs=3, model="contact", seed=0)
    env.reset()
    lists = [env.step(np.zeros((3, 3), dtype=np.float32))[3] for _ in range(8)]
    assert len({id(info) for infos in lists for info in infos}) == 24


def test_arrays_and_infos_are_never_reused():
    env = BallbotVecEnv(num_envs=2, seed=0, max_episode_steps=4)
    arrays, copies, infos = [env.reset()], [], []
    copies.append(arrays[0].copy())
    for actions in actions_of(2, 12):
        observations, rewards, dones, step_infos = env.step(actions)
        for array in (observations, rewards, dones):
            arrays.append(array)
            copies.append(array.copy())
        for info in step_infos:
            if "terminal_observation" in info:
                arrays.append(info["terminal_observation"])
                copies.append(info["terminal_observation"].copy())
        infos += step_infos
    for i, (held, saved) in enumerate(zip(arrays, copies, strict=True)):
        np.testing.assert_array_equal(held, saved)
        assert not any(np.shares_memory(held, other) for other in arrays[:i])
    assert len({id(info) for info in infos}) == len(infos)
    # What a learner writes into an info or an observation must not come back.
    first = env.reset()
    first[:] = 99.0
    observations, *_ = env.step(np.zeros((2, 3)))
    assert np.abs(observations).max() < 50


def test_terminal_observation_is_the_last_of_the_episode():
    seed, limit = 21, 30
    env = BallbotVecEnv(num_envs=3, seed=seed, max_episode_steps=limit)
    env.reset()
    singles = [BalanceEnv(max_episode_steps=limit) for _ in range(3)]
    for i, single in enumerate(singles):
        single.reset(seed=seed + i)
    last = [None] * 3
    for actions in actions_of(3, limit, scale=0.05):
        observations, _, dones, infos = env.step(actions)
        for i, single in enumerate(singles):
            last[i], _, terminated, truncated, _ = single.step(actions[i])
            assert dones[i] == (terminated or truncated)
    assert dones.all()
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(infos[i]["terminal_observation"], last[i])
        assert infos[i]["TimeLimit.truncated"] is True
        assert type(infos[i]["is_success"]) is bool
        np.testing.assert_array_equal(observations[i], single.reset()[0])


def test_a_fall_is_not_a_truncation():
    env = BallbotVecEnv(num_envs=1, seed=0)
    env.set_options({"state": State.at_rest(Params.paper(), tilt=(0.3, 0.0))})
    env.reset()
    for _ in range(60):
        _, _, dones, infos = env.step(np.zeros((1, 3)))
        if dones[0]:
            assert infos[0]["TimeLimit.truncated"] is False
            assert infos[0]["termination"] == env.metadata["terminations"].index("tilt")
            assert infos[0]["is_success"] is False
            return
    raise AssertionError("the robot did not fall")


def test_success_at_the_end_of_a_balanced_episode(balance):
    env = BallbotVecEnv(num_envs=2, seed=0, model="spatial", max_episode_steps=400)
    env.reset()
    for _ in range(400):
        *_, dones, infos = env.step(np.stack([balance(state) for state in env.get_attr("state")]))
    assert dones.all()
    assert [info["is_success"] for info in infos] == [True, True]
    assert all(info["termination"] == 0 and "episode" not in info for info in infos)


def test_seed_is_respected_once():
    env = BallbotVecEnv(num_envs=3)
    assert env.seed(30) == [30, 31, 32]
    observations = env.reset()
    for i, row in enumerate(observations):
        np.testing.assert_array_equal(row, BalanceEnv().reset(seed=30 + i)[0])
    assert env._seeds == [None, None, None]
    assert not np.array_equal(env.reset(), observations), "the seed was used twice"
    env.seed(30)
    np.testing.assert_array_equal(env.reset(), observations)
    np.testing.assert_array_equal(BallbotVecEnv(num_envs=3, seed=30).reset(), observations)
    assert not np.array_equal(BallbotVecEnv(num_envs=3).reset(), BallbotVecEnv(num_envs=3).reset())


def test_options_are_used_once_and_reset_infos_renewed(paper):
    env = BallbotVecEnv(num_envs=2, seed=0)
    state = State.at_rest(paper, tilt=(0.0, 0.05))
    env.set_options([{}, {"state": state}])
    env.reset_infos = [{"old": 1}, {"old": 1}]
    env.reset()
    np.testing.assert_allclose(env.states[1], state.to_array(), atol=1e-12)
    assert np.abs(env.states[0] - state.to_array()).max() > 1e-3
    assert env._options == [{}, {}]
    assert env.reset_infos == [UNDERWAY] * 2
    env.reset()
    assert np.abs(env.states[1] - state.to_array()).max() > 1e-3, "the option was used twice"
    env.set_options({"stat": state})
    with pytest.raises(ValueError, match="unknown reset option 'stat'"):
        env.reset()


def test_get_attr_set_attr_and_env_method():
    env = BallbotVecEnv(num_envs=3, seed=0, model="spatial")
    env.reset()
    assert env.get_attr("render_mode") == [None, None, None]
    states = env.get_attr("state")
    assert states[0] != states[1]
    assert env.get_attr("state", 1) == [states[1]]
    assert env.get_attr("state", [2, 0]) == [states[2], states[0]]
    assert env.get_attr("params", indices=0) == [Params.paper()]
    assert env.has_attr("state")
    assert not env.has_attr("nothing")
    env.set_attr("label", "x", indices=[0, 2])
    assert env.get_attr("label", [0, 2]) == ["x", "x"]
    with pytest.raises(AttributeError, match="label"):
        env.get_attr("label", 1)
    assert env.env_is_wrapped(Monitor) == [False, False, False]
    assert env.env_is_wrapped(Monitor, indices=1) == [False]
    assert env.env_method("push", [0.5, 0.0, 0.0], indices=[1]) == [None]
    env.env_method("set_params", Params.paper().replace(wheel_viscous_friction=0.002), indices=2)
    assert [p.wheel_viscous_friction for p in env.get_attr("params")] == [0.0, 0.0, 0.002]
    moved = env.get_attr("state")
    assert moved[1].body_velocity[0] > states[1].body_velocity[0] + 0.05
    assert moved[0] == states[0]
    assert [terms["alive"] for terms in env.env_method("reward_terms")] == [0.0, 0.0, 0.0]
    _, rewards, *_ = env.step(np.zeros((3, 3)))
    sums = [sum(terms.values()) for terms in env.env_method("reward_terms")]
    np.testing.assert_array_equal(rewards, np.float32(sums))
    with pytest.raises(AttributeError, match="nothing"):
        env.env_method("nothing")


def test_step_wait_needs_step_async():
    env = BallbotVecEnv(num_envs=1, seed=0)
    env.reset()
    with pytest.raises(RuntimeError, match="step_wait without step_async"):
        env.step_wait()
    env.step(np.zeros((1, 3)))
    with pytest.raises(RuntimeError, match="step_wait without step_async"):
        env.step_wait()


def first_ends(env, balance, steps):
    env.reset()
    ends = [[] for _ in range(env.num_envs)]
    for step in range(1, steps + 1):
        *_, dones, _ = env.step(np.stack([balance(state) for state in env.get_attr("state")]))
        for i in np.flatnonzero(dones):
            ends[i].append(step)
    return ends


def test_stagger_spreads_the_truncations(balance):
    options = {"num_envs": 4, "seed": 0, "model": "spatial", "max_episode_steps": 40}
    assert first_ends(BallbotVecEnv(**options), balance, 80) == [[40, 80]] * 4
    staggered = first_ends(BallbotVecEnv(stagger=True, **options), balance, 80)
    assert staggered == [[10, 50], [20, 60], [30, 70], [40, 80]]


@pytest.mark.parametrize("num_threads", [1, 2, 3])
def test_a_batch_equals_single_environments_for_any_number_of_threads(num_threads):
    env = BallbotVecEnv(num_envs=5, seed=9, num_threads=num_threads, max_episode_steps=25)
    singles = [BallbotVecEnv(num_envs=1, seed=9 + i, max_episode_steps=25) for i in range(5)]
    np.testing.assert_array_equal(env.reset(), np.concatenate([single.reset() for single in singles]))
    for actions in actions_of(5, 60, scale=0.8):
        found = env.step(actions)
        parts = [single.step(actions[i : i + 1]) for i, single in enumerate(singles)]
        expected = [np.concatenate([part[k] for part in parts]) for k in range(3)]
        assert_same_step(found, (*expected, [part[3][0] for part in parts]))


@pytest.mark.parametrize("convert", [np.asfortranarray, lambda a: a.astype(np.float64), np.ndarray.tolist])
def test_actions_of_any_memory_layout_are_equivalent(convert):
    env, twin = BallbotVecEnv(num_envs=4, seed=0), BallbotVecEnv(num_envs=4, seed=0)
    env.reset()
    twin.reset()
    for actions in actions_of(4, 5):
        assert_same_step(twin.step(convert(actions)), env.step(actions))


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_continue_bit_identically(duplicate):
    env = BallbotVecEnv(num_envs=3, seed=0, num_threads=2, max_episode_steps=30, stagger=True)
    env.reset()
    env.set_attr("label", "x")
    for actions in actions_of(3, 20):
        env.step(actions)
    twin = duplicate(env)
    assert twin.get_attr("label") == ["x"] * 3
    twin.env_method("push", [0.0, 0.0, 0.0])
    for actions in actions_of(3, 60, seed=1):
        assert_same_step(twin.step(actions), env.step(actions))
    twin.env_method("push", [1.0, 0.0, 0.0])
    assert not np.array_equal(twin.step(actions)[0], env.step(actions)[0]), "the copy is the original"


def test_make_vec_env_of_stable_baselines():
    env = make_vec_env(BALANCE, n_envs=2, seed=12)
    twin = BallbotVecEnv(num_envs=2, seed=12)
    np.testing.assert_array_equal(env.reset(), twin.reset())
    for actions in actions_of(2, 10):
        for ours, theirs in zip(env.step(actions)[:3], twin.step(actions)[:3], strict=True):
            np.testing.assert_array_equal(ours, theirs)
    env.close()


def step_elsewhere(env, actions, connection):
    connection.send([env.step(a)[0] for a in actions])
    connection.close()


def rollout_in_child(method, env, actions):
    """What `env` observes when another process steps it; None if that process hangs."""
    context = multiprocessing.get_context(method)
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=step_elsewhere, args=(env, actions, sender))
    process.start()
    sender.close()
    try:
        return receiver.recv() if receiver.poll(30) else None
    finally:
        process.kill()
        process.join()


@pytest.mark.slow("a process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize(
    ("kind", "method"), [(BallbotVecEnv, "fork"), (BalanceVectorEnv, "fork"), (BallbotVecEnv, "spawn")]
)
def test_a_child_process_steps_what_its_parent_has_stepped(kind, method):
    """A thread pool does not survive a fork: using the parent's in the child would wait forever."""
    env = kind(num_envs=4, seed=0, num_threads=2)
    env.reset()
    actions = actions_of(4, 20)
    for a in actions[:10]:
        env.step(a)
    found = rollout_in_child(method, env, actions[10:])
    assert found is not None, "the child process hangs"
    for a, observations in zip(actions[10:], found, strict=True):
        np.testing.assert_array_equal(env.step(a)[0], observations)


@pytest.mark.parametrize("num_envs", [0, -1])
def test_zero_environments_are_rejected(num_envs):
    with pytest.raises(ValueError, match=f"num_envs = {num_envs}, it must be at least 1"):
        BallbotVecEnv(num_envs=num_envs)


def test_an_unknown_environment_is_rejected():
    with pytest.raises(ValueError, match="unknown task 'walk': expected one of balance"):
        BallbotVecEnv(task="walk")
    with pytest.raises(TypeError, match="BallbotVecEnv got an unexpected keyword argument 'env_id'"):
        BallbotVecEnv(env_id=BALANCE)


def test_a_task_after_the_number_is_named():
    with pytest.raises(TypeError, match=r"'balance' follows it: write task='balance'"):
        BallbotVecEnv(128, "balance")
    with pytest.raises(TypeError, match="4 follows it: write num_envs=4"):
        BallbotVecEnv("balance", 4)
