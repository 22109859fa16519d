"""`BalanceVectorEnv` against single environments and against Gymnasium's own vectorization of them."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

from ballbot_rs import BalanceEnv, BalanceVectorEnv, BallbotVectorEnv, State
from tests.support.infos import assert_same_infos
from tests.support.names import BALANCE

#: Falls and truncations both happen within the steps that the tests take.
SHORT = {"model": "spatial", "max_episode_steps": 45}
MODES = ["next_step", "same_step", "disabled"]


def actions_of(num_envs, steps, seed=0, scale=1.0):
    return np.random.default_rng(seed).uniform(-scale, scale, (steps, num_envs, 3)).astype(np.float32)


@pytest.mark.parametrize("mode", MODES)
def test_equals_the_vectorization_of_gymnasium(mode):
    """The reference is SyncVectorEnv of single environments: observations, rewards, ends and infos."""
    n, enum = 4, AutoresetMode[mode.upper()]
    fast = BalanceVectorEnv(n, autoreset_mode=mode, num_threads=2, **SHORT)
    slow = gymnasium.vector.SyncVectorEnv([lambda: BalanceEnv(**SHORT)] * n, autoreset_mode=enum)
    found, expected = fast.reset(seed=3), slow.reset(seed=3)
    np.testing.assert_array_equal(found[0], expected[0])
    assert_same_infos(found[1], expected[1])
    ends = 0
    for actions in actions_of(n, 150, scale=0.3):
        found, expected = fast.step(actions), slow.step(actions)
        for ours, theirs in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        ended = found[2] | found[3]
        assert_same_infos(found[4], expected[4])
        ends += ended.sum()
        if mode == "disabled" and ended.any():
            ours, theirs = (env.reset(options={"reset_mask": ended.copy()}) for env in (fast, slow))
            np.testing.assert_array_equal(ours[0][ended], theirs[0][ended])
            assert_same_infos(ours[1], theirs[1])
    assert ends > 2 * n


@pytest.mark.parametrize("num_threads", [1, 2])
@pytest.mark.parametrize("model", ["rigid", "contact", "spatial"])
def test_each_environment_equals_a_single_environment(num_threads, model):
    n, seed, steps = 5, 40, 130
    options = {"model": model, "max_episode_steps": 60}
    vector = BalanceVectorEnv(n, num_threads=num_threads, **options)
    observations, _ = vector.reset(seed=seed)
    singles = [BalanceEnv(**options) for _ in range(n)]
    over = [False] * n
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(observations[i], single.reset(seed=seed + i)[0])
    ends = 0
    for actions in actions_of(n, steps, scale=0.5):
        observations, rewards, terminated, truncated, _ = vector.step(actions)
        for i, single in enumerate(singles):
            expected = (single.reset()[0], 0.0, False, False) if over[i] else single.step(actions[i])[:4]
            np.testing.assert_array_equal(observations[i], expected[0])
            assert (rewards[i], terminated[i], truncated[i]) == expected[1:]
            over[i] = expected[2] or expected[3]
            ends += over[i]
    assert ends >= n


def test_results_do_not_depend_on_the_number_of_threads():
    runs = []
    for num_threads in (1, 2, 3, None):
        env = BalanceVectorEnv(7, num_threads=num_threads, autoreset_mode="same_step", max_episode_steps=30)
        first, _ = env.reset(seed=1)
        runs.append([first, *(np.column_stack(env.step(a)[:4]) for a in actions_of(7, 50))])
    for run in runs[1:]:
        for found, expected in zip(run, runs[0], strict=True):
            np.testing.assert_array_equal(found, expected)


def test_make_vec_with_defaults():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make_vec(BALANCE, num_envs=3)
    assert type(env) is BalanceVectorEnv
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.autoreset_mode is AutoresetMode.NEXT_STEP
    assert env.observation_space.shape == (3, 16)
    assert env.action_space.shape == (3, 3)
    env.action_space.seed(0)
    observations, info = env.reset(seed=0)
    assert observations in env.observation_space
    assert info["_is_success"].all()
    observations, rewards, terminated, truncated, info = env.step(env.action_space.sample())
    assert observations in env.observation_space
    assert (rewards.shape, rewards.dtype) == ((3,), np.float64)
    assert (terminated.dtype, truncated.dtype) == (np.bool_, np.bool_)
    assert (info["is_success"].dtype, info["termination"].dtype) == (np.bool_, np.int64)
    env.close()


@pytest.mark.parametrize("vectorization", ["vector_entry_point", "sync", "async"])
def test_every_vectorization_mode_gives_the_same_numbers(vectorization):
    reference = BalanceVectorEnv(2)
    env = gymnasium.make_vec(BALANCE, num_envs=2, vectorization_mode=vectorization)
    try:
        np.testing.assert_array_equal(env.reset(seed=6)[0], reference.reset(seed=6)[0])
        for actions in actions_of(2, 10):
            found, expected = env.step(actions), reference.step(actions)
            for ours, theirs in zip(found[:4], expected[:4], strict=True):
                np.testing.assert_array_equal(ours, theirs)
    finally:
        env.close()


@pytest.mark.parametrize("mode", ["same_step", "same-step", "SAME_STEP", "SameStep", AutoresetMode.SAME_STEP])
def test_autoreset_mode_by_name_or_enum(mode):
    env = gymnasium.make_vec(BALANCE, num_envs=2, autoreset_mode=mode)
    assert env.autoreset_mode is AutoresetMode.SAME_STEP
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert BalanceVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP, "the class was changed"


@pytest.mark.parametrize("mode", ["sometimes", "", 3, None])
def test_unknown_autoreset_modes_are_rejected(mode):
    with pytest.raises(ValueError, match="autoreset mode"):
        BalanceVectorEnv(2, autoreset_mode=mode)


def test_next_step_resets_one_step_later_and_ignores_the_action(balance):
    env = BalanceVectorEnv(2, model="spatial", seed=0)
    leaning = State.at_rest(env.params, tilt=(0.2, 0.0))
    env.reset(options={"states": [State.at_rest(env.params), leaning]})
    terminated = np.zeros(2, dtype=bool)
    for _ in range(45):
        actions = np.stack([balance(env.get_attr("state")[0]), np.zeros(3, dtype=np.float32)])
        observations, _, terminated, _, info = env.step(actions)
        if terminated.any():
            break
    assert terminated.tolist() == [False, True]
    assert info["_termination"].tolist() == info["_is_success"].tolist() == [True, True]
    assert [env.metadata["terminations"][code] for code in info["termination"]] == ["none", "tilt"]
    cosine = 1.0 - 0.1 * observations[1, 2]
    assert cosine < np.cos(np.deg2rad(19.9)), "this is not the last observation of the episode"
    observations, rewards, terminated, truncated, info = env.step(np.ones((2, 3)))
    assert rewards[0] > 0.5
    assert (rewards[1], terminated[1], truncated[1], info["termination"][1]) == (0.0, False, False, 0)
    np.testing.assert_array_equal(observations[:, 13:16], [[2, 2, 2], [0, 0, 0]])
    assert env.get_attr("state")[1].tilt < np.deg2rad(5.01)


def test_wrappers_count_episodes_right():
    plain = BalanceVectorEnv(3, **SHORT)
    env = NormalizeObservation(RecordEpisodeStatistics(gymnasium.make_vec(BALANCE, num_envs=3, **SHORT)))
    plain.reset(seed=2)
    observations, _ = env.reset(seed=2)
    returns, lengths, resetting = np.zeros(3), np.zeros(3, dtype=int), np.zeros(3, dtype=bool)
    episodes = 0
    for actions in actions_of(3, 120, scale=0.4):
        observations, rewards, terminated, truncated, info = env.step(actions)
        expected = plain.step(actions)
        np.testing.assert_array_equal(rewards, expected[1])
        returns[resetting], lengths[resetting] = 0.0, 0
        returns += np.where(resetting, 0.0, rewards)
        lengths += ~resetting
        resetting = terminated | truncated
        if resetting.any():
            np.testing.assert_array_equal(info["_episode"], resetting)
            np.testing.assert_array_equal(info["episode"]["l"][resetting], lengths[resetting])
            np.testing.assert_allclose(info["episode"]["r"][resetting], returns[resetting], rtol=1e-6)
            episodes += resetting.sum()
        assert np.isfinite(observations).all()
    assert episodes >= 6
    assert np.abs(observations - expected[0]).max() > 1e-3, "NormalizeObservation did nothing"


def test_same_step_returns_the_last_observation_separately():
    env = BalanceVectorEnv(3, autoreset_mode="same_step", **SHORT)
    shadow = BalanceVectorEnv(3, autoreset_mode="next_step", **SHORT)
    env.reset(seed=8)
    shadow.reset(seed=8)
    for actions in actions_of(3, 45):
        observations, _, terminated, truncated, info = env.step(actions)
        last, _, ended, _, _ = shadow.step(actions)
        if terminated.any():
            np.testing.assert_array_equal(terminated, ended)
            np.testing.assert_array_equal(info["_final_obs"], terminated | truncated)
            np.testing.assert_array_equal(info["_final_info"], terminated | truncated)
            np.testing.assert_array_equal(info["final_obs"][terminated], last[terminated])
            assert not np.array_equal(observations[terminated], last[terminated])
            assert (info["final_info"]["termination"] == terminated).all()
            assert not info["final_info"]["is_success"].any()
            assert not info["termination"].any()
            return
        assert "final_info" not in info
    raise AssertionError("no robot fell")


def test_disabled_mode_resets_by_mask_only():
    env = BalanceVectorEnv(3, autoreset_mode="disabled", max_episode_steps=3)
    first, _ = env.reset(seed=0)
    for actions in actions_of(3, 3, scale=0.1):
        _, _, _, truncated, _ = env.step(actions)
    assert truncated.all()
    with pytest.raises(ValueError, match="the episode of environment 0 is over"):
        env.step(np.zeros((3, 3)))
    mask = np.array([True, False, True])
    again, _ = env.reset(seed=0, options={"reset_mask": mask})
    np.testing.assert_array_equal(again[mask], first[mask])
    with pytest.raises(ValueError, match="the episode of environment 1 is over"):
        env.step(np.zeros((3, 3)))


def test_a_masked_reset_leaves_the_other_observations_as_they_are():
    env = BalanceVectorEnv(3, autoreset_mode="disabled")
    env.reset(seed=0)
    seen, *_ = env.step(actions_of(3, 1)[0])
    observations, _ = env.reset(options={"reset_mask": np.array([True, False, True])})
    np.testing.assert_array_equal(observations[1], seen[1])


def test_every_step_returns_fresh_memory():
    env = BalanceVectorEnv(2)
    kept = [env.reset(seed=0)[0]]
    copies = [kept[0].copy()]
    for actions in actions_of(2, 6):
        kept.append(env.step(actions)[0])
        copies.append(kept[-1].copy())
    for i, (held, saved) in enumerate(zip(kept, copies, strict=True)):
        np.testing.assert_array_equal(held, saved)
        assert not any(np.shares_memory(held, other) for other in kept[:i])


def test_seeds_as_a_list():
    env = BalanceVectorEnv(3)
    all_three, _ = env.reset(seed=[10, 20, 30])
    for row, seed in zip(all_three, [10, 20, 30], strict=True):
        np.testing.assert_array_equal(row, BalanceEnv().reset(seed=seed)[0])
    second, _ = env.reset()
    env.reset(seed=[10, 20, 30])
    again, _ = env.reset(seed=[10, None, 30])
    np.testing.assert_array_equal(again[[0, 2]], all_three[[0, 2]])
    np.testing.assert_array_equal(again[1], second[1])
    np.testing.assert_array_equal(env.reset(seed=np.array([10, 20, 30]))[0], all_three)
    np.testing.assert_array_equal(env.reset(seed=np.int64(5))[0], env.reset(seed=5)[0])


def test_constructor_seed_equals_the_seed_of_the_first_reset():
    np.testing.assert_array_equal(BalanceVectorEnv(2, seed=5).reset()[0], BalanceVectorEnv(2).reset(seed=5)[0])
    assert not np.array_equal(BalanceVectorEnv(2).reset()[0], BalanceVectorEnv(2).reset()[0])


def test_reset_to_given_states(paper):
    state = State.at_rest(paper, tilt=(0.03, 0.0))
    env = BalanceVectorEnv(2)
    observations, _ = env.reset(seed=4, options={"states": [None, state]})
    np.testing.assert_allclose(env.get_attr("state")[1].to_array(), state.to_array(), atol=1e-12)
    np.testing.assert_array_equal(observations[0], BalanceEnv().reset(seed=4)[0])
    np.testing.assert_array_equal(observations[1], BalanceEnv().reset(options={"state": state})[0])


def test_call_get_attr_and_set_attr():
    env = BalanceVectorEnv(2)
    env.reset(seed=0)
    assert [type(state) for state in env.get_attr("state")] == [State, State]
    assert env.call("state") == env.get_attr("state")
    assert env.get_attr("params") == (env.params, env.params)
    before = env.states
    env.step(np.zeros((2, 3)))
    terms = env.call("reward_terms")
    assert [t["alive"] for t in terms] == [1.0, 1.0]
    env.call("push", [0.5, 0.0, 0.0])
    rough = env.params.replace(wheel_viscous_friction=0.001)
    env.call("set_params", rough)
    assert env.get_attr("params") == (rough, rough)
    env.step(np.zeros((2, 3)))
    assert (env.states[:, 20] > before[:, 20] + 0.05).all(), "the push did not move the bodies"
    env.set_attr("note", "same")
    assert env.get_attr("note") == ("same", "same")
    env.set_attr("note", [1, 1])
    assert env.note == 1
    env.set_attr("grade", ["easy", "hard"])
    assert env.get_attr("grade") == ("easy", "hard")
    assert copy.deepcopy(env).get_attr("grade") == ("easy", "hard")
    env.set_attr("grade", ("hard", "easy"))
    assert env.call("grade") == ("hard", "easy")
    env.set_attr("grade", "easy")
    assert env.get_attr("grade") == ("easy", "easy")
    with pytest.raises(ValueError, match="render_mode is shared by all environments, but the values given differ"):
        env.set_attr("render_mode", [None, "rgb_array"])
    with pytest.raises(ValueError, match="3 values for num_envs = 2"):
        env.set_attr("note", [1, 1, 1])
    env.set_attr("note", np.arange(3))
    np.testing.assert_array_equal(env.note, [0, 1, 2])
    with pytest.raises(AttributeError, match="nothing"):
        env.get_attr("nothing")
    with pytest.raises(AttributeError, match="nothing"):
        env.call("nothing")


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_continue_bit_identically(mode, duplicate):
    env = BalanceVectorEnv(3, autoreset_mode=mode, num_threads=2, max_episode_steps=40)
    env.reset(seed=1)
    actions = actions_of(3, 120, scale=0.5)
    for a in actions[:20]:
        env.step(a)
    twin = duplicate(env)
    assert twin.autoreset_mode is env.autoreset_mode
    ends = 0
    for a in actions[20:]:
        found, expected = twin.step(a), env.step(a)
        for ours, theirs in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert_same_infos(found[4], expected[4])
        ends += (found[2] | found[3]).sum()
    assert ends >= 6


def test_spec_survives_json():
    env = gymnasium.make_vec(
        BALANCE, num_envs=3, autoreset_mode="same_step", max_episode_steps=20, model="planar", num_threads=1
    )
    again = gymnasium.make_vec(EnvSpec.from_json(env.spec.to_json()))
    assert again.num_envs == 3
    assert again.autoreset_mode is AutoresetMode.SAME_STEP
    np.testing.assert_array_equal(again.reset(seed=1)[0], env.reset(seed=1)[0])
    for actions in actions_of(3, 20, scale=0.1):
        *_, truncated, _ = again.step(actions)
    assert truncated.all()


@pytest.mark.parametrize(
    "convert",
    [
        lambda a: a.astype(np.float64),
        np.asfortranarray,
        lambda a: np.asfortranarray(a, dtype=np.float64),
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
        np.ndarray.tolist,
    ],
    ids=["float64", "fortran", "fortran float64", "strided", "list"],
)
def test_actions_of_any_memory_layout_are_equivalent(convert):
    reference, env = BalanceVectorEnv(4), BalanceVectorEnv(4)
    reference.reset(seed=0)
    env.reset(seed=0)
    for actions in actions_of(4, 5):
        converted = convert(actions)
        np.testing.assert_array_equal(env.step(converted)[0], reference.step(actions)[0])


def test_a_rejected_step_moves_nothing():
    env, twin = BalanceVectorEnv(2), BalanceVectorEnv(2)
    env.reset(seed=0)
    twin.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions\[1, 2\] = NaN"):
        env.step([[0, 0, 0], [0, 0, np.nan]])
    with pytest.raises(ValueError, match=r"shape \(3, 2\), expected \(2, 3\)"):
        env.step(np.zeros((3, 2)))
    np.testing.assert_array_equal(env.states, twin.states)
    np.testing.assert_array_equal(env.step(np.zeros((2, 3)))[0], twin.step(np.zeros((2, 3)))[0])


def test_the_scalar_time_limit_is_rejected():
    with pytest.raises(TypeError, match=r"gymnasium\.Env"):
        gymnasium.wrappers.TimeLimit(BalanceVectorEnv(2), 10)


def test_step_before_reset_is_rejected():
    with pytest.raises(ValueError, match="before the first reset"):
        BalanceVectorEnv(2).step(np.zeros((2, 3)))


def test_infos_equal_make_vec_without_our_batch():
    made = {"num_envs": 3, "max_episode_steps": 40, "model": "spatial"}
    fast = gymnasium.make_vec(BALANCE, **made)
    slow = SyncVectorEnv([lambda: BalanceEnv(max_episode_steps=40, model="spatial")] * 3)
    fast.reset(seed=1)
    slow.reset(seed=1)
    for actions in actions_of(3, 100, scale=0.2):
        found, expected = fast.step(actions), slow.step(actions)
        assert found[1].dtype == expected[1].dtype
        assert_same_infos(found[4], expected[4])


def test_a_task_after_the_number_is_named():
    with pytest.raises(TypeError, match=r"'goal' follows it: write task='goal'"):
        BallbotVectorEnv(8, "goal")
