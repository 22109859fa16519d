"""`BalanceEnv` against Gymnasium's contract, and the mistakes that a learner would swallow without an error."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from ballbot_rs import BalanceEnv, Params, State
from tests.support.names import BALANCE

MODELS = ["rigid", "contact", "spatial", "planar"]
ZERO = np.zeros(3, dtype=np.float32)


def run_to_end(env, act, limit=3000):
    """Steps with `act(env)` to the end of the episode; the number of steps and the last step's results."""
    for step in range(1, limit + 1):
        result = env.step(act(env))
        if result[2] or result[3]:
            return step, result
    raise AssertionError(f"the episode did not end within {limit} steps")


@pytest.mark.parametrize("model", MODELS)
def test_the_checker_of_gymnasium_reports_nothing(model):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(BALANCE, model=model).unwrapped)


def test_the_checker_of_stable_baselines_reports_nothing():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(BalanceEnv())


def test_registration():
    spec = gymnasium.spec(BALANCE)
    assert spec.max_episode_steps == 1000
    assert spec.reward_threshold == 950.0
    assert not spec.nondeterministic


def test_spaces_and_python_types():
    env = gymnasium.make(BALANCE)
    assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    space = env.observation_space
    assert space.shape == (16,)
    assert space.dtype == np.float32
    assert np.isfinite(space.low).all()
    np.testing.assert_array_equal(space.low, -space.high)
    observation, info = env.reset(seed=0)
    assert observation in space
    assert observation.dtype == np.float32
    assert info == {"is_success": False, "termination": 0}
    observation, reward, terminated, truncated, info = env.step(ZERO)
    assert observation in space
    assert observation.dtype == np.float32
    assert type(reward) is float
    assert type(terminated) is bool
    assert type(truncated) is bool
    assert info == {"is_success": False, "termination": 0}


def test_observation_rows_match_the_documentation():
    env = BalanceEnv(setpoint=(0.3, -0.1), scale_observations=False)
    yaw, tilt = 0.7, 0.04
    state = State.at_rest(env.params, tilt=(tilt, 0.0), yaw=yaw).replace(
        body_angular_velocity=(0.1, 0.2, 0.3), wheel_speeds=(1.0, 2.0, 3.0), ball_velocity=(0.5, 0.0, 0.0)
    )
    observation, _ = env.reset(options={"state": state})
    to_heading = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    # Tilting about the inertial x axis leans the mast towards -y.
    gravity = np.append(to_heading @ [0.0, np.sin(tilt)], 0.0)
    assert observation[2] == pytest.approx(-np.cos(tilt), abs=1e-6)
    np.testing.assert_allclose(observation[:2], -gravity[:2], atol=1e-6)
    np.testing.assert_allclose(observation[3:6], [0.1, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(observation[6:9], [1.0, 2.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(observation[9:11], to_heading @ [-0.3, 0.1], atol=1e-6)
    np.testing.assert_allclose(observation[11:13], to_heading @ [0.5, 0.0], atol=1e-6)
    np.testing.assert_array_equal(observation[13:16], 0.0)
    observation, *_ = env.step([0.25, -2.0, 0.5])
    np.testing.assert_array_equal(observation[13:16], np.float32([0.25, -1.0, 0.5]))


def test_seed_decides_the_start_and_what_follows():
    env, other = BalanceEnv(), BalanceEnv()
    first = env.reset(seed=7)[0]
    following = env.reset()[0]
    assert not np.array_equal(first, following)
    assert not np.array_equal(first, env.reset(seed=8)[0])
    np.testing.assert_array_equal(env.reset(seed=7)[0], first)
    np.testing.assert_array_equal(env.reset()[0], following)
    np.testing.assert_array_equal(other.reset(seed=7)[0], first)
    assert not np.array_equal(BalanceEnv().reset()[0], BalanceEnv().reset()[0]), "unseeded starts are the same"


def test_same_seed_same_episode():
    runs = []
    for _ in range(2):
        env = gymnasium.make(BALANCE)
        observations = [env.reset(seed=11)[0]]
        rewards = []
        for action in np.random.default_rng(0).uniform(-1, 1, (30, 3)):
            observation, reward, terminated, _, _ = env.step(action)
            observations.append(observation)
            rewards.append(reward)
            if terminated:
                break
        runs.append((np.array(observations), rewards))
    np.testing.assert_array_equal(runs[0][0], runs[1][0])
    assert runs[0][1] == runs[1][1]


def test_every_step_returns_fresh_memory():
    env = BalanceEnv()
    kept = [env.reset(seed=0)[0]]
    copies = [kept[0].copy()]
    infos = []
    for _ in range(5):
        observation, _, _, _, info = env.step([0.3, -0.2, 0.1])
        kept.append(observation)
        copies.append(observation.copy())
        infos.append(info)
    kept.append(env.reset()[0])
    copies.append(kept[-1].copy())
    for i, (held, saved) in enumerate(zip(kept, copies, strict=True)):
        np.testing.assert_array_equal(held, saved, err_msg=f"observation {i} changed afterwards")
        assert not any(np.shares_memory(held, other) for other in kept[:i])
    assert len({id(info) for info in infos}) == len(infos)
    assert len(np.unique(np.array(kept), axis=0)) == len(kept)


def test_truncated_not_terminated_after_exactly_1000_steps(balance):
    env = gymnasium.make(BALANCE)
    env.reset(seed=3)
    steps, (_, reward, terminated, truncated, info) = run_to_end(env, lambda e: balance(e.unwrapped.state))
    assert steps == 1000
    assert truncated is True
    assert terminated is False
    assert info == {"is_success": True, "termination": 0}
    assert reward > 0.9


@pytest.mark.parametrize("length", [37, 1200])
def test_make_honors_max_episode_steps(balance, length):
    env = gymnasium.make(BALANCE, max_episode_steps=length, model="spatial")
    for _ in range(2):
        env.reset(seed=3)
        steps, (_, _, terminated, truncated, _) = run_to_end(env, lambda e: balance(e.unwrapped.state))
        assert (steps, terminated, truncated) == (length, False, True)


@pytest.mark.parametrize(("length", "success"), [(5, False), (900, True), (1200, True)])
def test_success_is_reported_at_the_end_that_make_sets(balance, length, success):
    env = gymnasium.make(BALANCE, max_episode_steps=length, model="spatial")
    env.reset(seed=3)
    _, (*_, info) = run_to_end(env, lambda e: balance(e.unwrapped.state))
    assert info["is_success"] == success
    assert env.unwrapped.is_success is success


def test_constructor_honors_max_episode_steps(balance):
    env = BalanceEnv(max_episode_steps=12, model="spatial")
    env.reset(seed=0)
    steps, (_, _, terminated, truncated, _) = run_to_end(env, lambda e: balance(e.state))
    assert (steps, terminated, truncated) == (12, False, True)


def test_survival_without_precision_is_not_success(balance):
    env = BalanceEnv(model="spatial", max_episode_steps=300, success_radius=1e-9)
    env.reset(seed=1)
    _, (_, _, _, truncated, info) = run_to_end(env, lambda e: balance(e.state))
    assert truncated
    assert info == {"is_success": False, "termination": 0}


def test_a_fall_terminates_with_its_reason():
    env = gymnasium.make(BALANCE)
    env.reset(seed=0)
    steps, (_, reward, terminated, truncated, info) = run_to_end(env, lambda _: ZERO)
    assert steps < 300
    assert (terminated, truncated) == (True, False)
    assert info == {"is_success": False, "termination": 1}
    assert env.unwrapped.metadata["terminations"] == ["none", "tilt", "bot_on_floor", "diverged"]
    assert env.unwrapped.state.tilt > np.deg2rad(20)
    assert env.unwrapped.reward_terms()["alive"] == 0.0
    assert reward < 0.0


def test_a_robot_that_may_lean_ends_on_the_floor():
    env = BalanceEnv(fall_tilt=3.1)
    env.reset(seed=0)
    _, (observation, _, terminated, _, info) = run_to_end(env, lambda _: ZERO)
    assert terminated
    assert env.metadata["terminations"][info["termination"]] == "bot_on_floor"
    assert observation in env.observation_space


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("impulse", [1e3, 1e4])
def test_divergence_ends_the_episode_with_finite_numbers(model, impulse):
    env = BalanceEnv(model=model, fall_tilt=3.1)
    env.reset(seed=0)
    env.push([impulse, 0.0, 0.0])
    _, (observation, reward, terminated, truncated, info) = run_to_end(env, lambda _: ZERO, limit=20)
    assert terminated
    assert not truncated
    assert env.metadata["terminations"][info["termination"]] == "diverged"
    assert np.isfinite(observation).all()
    assert observation in env.observation_space
    assert np.isfinite(reward)
    # The next episode equals an episode in a new environment.
    np.testing.assert_array_equal(env.reset(seed=4)[0], BalanceEnv(model=model).reset(seed=4)[0])
    env.step(ZERO)


def test_reset_to_a_given_state(paper):
    state = State.rolling(paper, ball_velocity=(0.2, -0.1))
    env = gymnasium.make(BALANCE)
    env.reset(seed=9, options={"state": state})
    np.testing.assert_allclose(env.unwrapped.state.to_array(), state.to_array(), atol=1e-12)
    # A given start uses no random numbers.
    drawn = env.reset()[0]
    np.testing.assert_array_equal(drawn, BalanceEnv().reset(seed=9)[0])


def test_reset_rejects_unknown_options():
    env = BalanceEnv()
    with pytest.raises(ValueError, match="unknown reset option 'stat': expected one of state"):
        env.reset(options={"stat": 1})
    with pytest.raises(TypeError, match="State"):
        env.reset(options={"state": [0.0] * 32})


def test_a_finished_episode_must_be_reset():
    env = BalanceEnv(max_episode_steps=2)
    with pytest.raises(ValueError, match="has not begun"):
        env.step(ZERO)
    env.reset(seed=0)
    env.step(ZERO)
    env.step(ZERO)
    with pytest.raises(ValueError, match="the episode of environment 0 is over"):
        env.step(ZERO)
    env.reset()
    env.step(ZERO)


def test_reward_is_the_sum_of_its_terms():
    env = BalanceEnv(reward={"tilt": 3.0, "alive": 2.0})
    env.reset(seed=2)
    assert sum(env.reward_terms().values()) == 0.0
    for action in np.random.default_rng(1).uniform(-1, 1, (20, 3)):
        _, reward, *_ = env.step(action)
        terms = env.reward_terms()
        assert set(terms) == {
            "alive",
            "tilt",
            "position",
            "velocity",
            "yaw_rate",
            "rate",
            "action",
            "action_change",
        }
        assert terms["alive"] == 2.0
        assert all(value <= 0.0 for name, value in terms.items() if name != "alive")
        assert terms["tilt"] == pytest.approx(-3.0 * (env.state.tilt / np.deg2rad(20)) ** 2, rel=1e-9)
        assert reward == pytest.approx(sum(terms.values()), abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_copies_continue_bit_identically(model, duplicate):
    env = gymnasium.make(BALANCE, model=model, max_episode_steps=25)
    env.reset(seed=5)
    env.unwrapped.set_params(env.unwrapped.params.replace(wheel_viscous_friction=1e-4))
    actions = np.random.default_rng(2).uniform(-0.3, 0.3, (60, 3))
    for action in actions[:10]:
        env.step(action)
    twin = duplicate(env)
    ends = 0
    for action in actions[10:]:
        (a, *scores), (b, *twin_scores) = env.step(action), twin.step(action)
        np.testing.assert_array_equal(a, b)
        assert scores == twin_scores
        if scores[1] or scores[2]:
            ends += 1
            np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])
    assert ends >= 2


def test_a_copy_keeps_its_last_reward():
    env = BalanceEnv()
    env.reset(seed=5)
    env.step([0.1, 0.2, 0.3])
    assert copy.deepcopy(env).reward_terms() == env.reward_terms()


def test_a_copy_is_independent():
    env = BalanceEnv()
    env.reset(seed=5)
    before = env.state
    copy.deepcopy(env).step([1.0, 1.0, 1.0])
    assert env.state == before


def test_spec_survives_json():
    env = gymnasium.make(BALANCE, max_episode_steps=50, model="planar", setpoint=[0.1, 0.0])
    spec = gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())
    again = gymnasium.make(spec)
    assert again.spec.max_episode_steps == 50
    np.testing.assert_array_equal(again.reset(seed=1)[0], env.reset(seed=1)[0])


@pytest.mark.parametrize(
    "convert",
    [
        lambda a: a.astype(np.float64),
        lambda a: a.tolist(),
        tuple,
        lambda a: np.repeat(a, 2)[::2],
        lambda a: a[::-1].copy()[::-1],
        lambda a: np.asfortranarray(np.stack([a, a]))[1],
        lambda a: a.astype(">f4"),
    ],
    ids=["float64", "list", "tuple", "strided", "reversed", "fortran row", "big endian"],
)
def test_actions_of_any_memory_layout_are_equivalent(convert):
    action = np.array([0.5, -0.25, 0.125], dtype=np.float32)
    env, other = BalanceEnv(), BalanceEnv()
    env.reset(seed=0)
    other.reset(seed=0)
    for _ in range(3):
        expected = env.step(action)
        found = other.step(convert(action))
        np.testing.assert_array_equal(found[0], expected[0])
        assert found[1:] == expected[1:]


def test_other_parameters_make_another_robot():
    heavy = BalanceEnv(robot=Params.paper().replace(body_mass=4.0))
    light = BalanceEnv()
    assert heavy.params.body_mass == 4.0
    heavy.reset(seed=0)
    light.reset(seed=0)
    action = np.float32([0.2, 0.2, -0.4])
    assert not np.array_equal(heavy.step(action)[0], light.step(action)[0])
