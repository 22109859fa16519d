"""Tasks in Python: through all front ends, with their seeds, resets, ends, and errors."""

import importlib.util
import inspect
import pickle
import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs._state_rows import tilt_of
from ballbot_rs.envs._batch_env import new_batch, option_names
from ballbot_rs.envs.own.registry import TAKEN
from ballbot_rs.envs.registration import description_of
from tests.support.paths import ROOT

#: Some fall, others do not.
SHORT = {"max_episode_steps": 25}


class Spin(bb.Task):
    """Turn at 2 rad/s."""

    max_episode_steps = 60

    def observe(self, robots):
        return np.column_stack([robots.gravity, robots.body_rate, robots.wheel_speeds])

    def reward(self, robots):
        return 1.0 - np.abs(robots.yaw_rate - 2.0)

    def terminated(self, robots):
        return robots.tilt > 0.15


class Chase(bb.Task):
    """Go to a point that is sampled for each episode; with a memory and a custom argument."""

    def __init__(self, distance=1.0):
        self.distance = distance
        self.goals = np.zeros((0, 2))

    def reset(self, robots, chosen, rngs):  # noqa: ARG002
        if chosen.max() >= len(self.goals):
            self.goals = np.vstack([self.goals, np.zeros((chosen.max() + 1 - len(self.goals), 2))])
        self.goals[chosen] = [rng.uniform(-self.distance, self.distance, 2) for rng in rngs]

    def observe(self, robots):
        return np.column_stack([robots.gravity, self.goals[robots.numbers], robots.ball_position[:, :2], robots.time])

    def reward(self, robots):
        return -np.linalg.norm(robots.ball_position[:, :2] - self.goals[robots.numbers], axis=1)

    def success(self, robots):
        return robots.steps >= 10


@pytest.fixture(autouse=True)
def registered():
    bb.register("me/Spin-v0", Spin)
    bb.register("me/Chase-v0", Chase, distance=0.5)


def actions(step, n):
    return 0.4 * np.sin(np.arange(3 * n).reshape(n, 3) * 7 + 3 * step).astype(np.float32)


def test_gymnasium_checks_the_environment():
    env = gymnasium.make("me/Spin-v0", model="contact")
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (9,)
    assert env.spec.max_episode_steps == 60


@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_many_robots_equal_single_robots(mode):
    n = 6
    vector = gymnasium.make_vec("me/Spin-v0", num_envs=n, autoreset_mode=mode, model="contact", **SHORT).unwrapped
    singles = [bb.BallbotEnv("me/Spin-v0", model="contact", **SHORT) for _ in range(n)]
    seen, _ = vector.reset(seed=4)
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=4 + i)[0], seen[i])
    over = np.zeros(n, dtype=bool)
    reasons = set()
    for step in range(150):
        if step == 40:
            vector = pickle.loads(pickle.dumps(vector))
        if mode == "disabled" and over.any():
            observations, _ = vector.reset(options={"reset_mask": over})
            for i in np.flatnonzero(over):
                np.testing.assert_array_equal(singles[i].reset()[0], observations[i])
            over[:] = False
        observations, rewards, terminated, truncated, infos = vector.step(actions(step, n))
        for i, single in enumerate(singles):
            if over[i]:
                np.testing.assert_array_equal(single.reset()[0], observations[i])
                over[i] = False
                assert rewards[i] == 0.0
                continue
            expected, reward, is_terminated, is_truncated, info = single.step(actions(step, n)[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, is_terminated, is_truncated), (step, i)
            if is_terminated or is_truncated:
                reasons.add(vector.metadata["terminations"][info["termination"]])
                final = infos["final_info"] if mode == "same_step" else infos
                assert {name: final[name][i] for name in info} == info
                if mode == "same_step":
                    np.testing.assert_array_equal(infos["final_obs"][i], expected)
                    expected = single.reset()[0]
                else:
                    over[i] = True
            np.testing.assert_array_equal(expected, observations[i])
    assert reasons == {"task", "none"}


def test_rewards_and_ends_follow_from_the_states():
    env = bb.BallbotVectorEnv(7, task="me/Spin-v0", autoreset_mode="disabled", model="contact")
    env.reset(seed=0)
    for step in range(20):
        observations, rewards, terminated, _, _ = env.step(actions(step, 7))
        for i, state in enumerate(env.state):
            up = state.body_quaternion
            w, x, y, z = up
            gravity = -np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
            np.testing.assert_allclose(observations[i, :3], gravity, atol=1e-6)
            np.testing.assert_allclose(observations[i, 3:6], state.body_angular_velocity, rtol=1e-5, atol=1e-6)
            rate = -gravity @ state.body_angular_velocity
            assert rewards[i] == pytest.approx(1.0 - abs(rate - 2.0), abs=1e-5)
            assert terminated[i] == (state.tilt > 0.15)
        if terminated.any():
            env.reset(options={"reset_mask": terminated})


def test_stable_baselines3_trains_on_it():
    sb3 = pytest.importorskip("stable_baselines3")
    env = bb.BallbotVecEnv("me/Spin-v0", num_envs=16, model="contact", seed=1)
    model = sb3.PPO("MlpPolicy", env, n_steps=32, batch_size=128, n_epochs=1, device="cpu", seed=0).learn(1024)
    assert model.num_timesteps == 1024
    assert env.env_method("reward_terms", indices=[0])[0].keys() == {"reward"}
    copied = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(copied.step(actions(0, 16))[0], env.step(actions(0, 16))[0])


def test_memory_arguments_and_seeds():
    options = {"model": "contact", "max_episode_steps": 20}
    env = bb.BallbotVectorEnv(3, task="me/Chase-v0", autoreset_mode="disabled", **options)
    first, _ = env.reset(seed=8)
    assert np.abs(first[:, 3:5]).max() <= 0.5
    assert len(np.unique(first[:, 3])) == 3
    again, _ = env.reset(seed=8)
    np.testing.assert_array_equal(again, first)
    wide, _ = bb.BallbotVectorEnv(3, task="me/Chase-v0", distance=5.0, **options).reset(seed=8)
    np.testing.assert_allclose(wide[:, 3:5], 10.0 * first[:, 3:5], rtol=1e-6)
    for _ in range(20):
        observations, _, _, truncated, info = env.step(np.zeros((3, 3)))
    assert truncated.all()
    assert info["is_success"].all()
    np.testing.assert_allclose(observations[:, -1], 0.2, rtol=1e-6)


def test_sensors_are_observed_and_the_truth_is_rewarded():
    seen = {}

    class Watch(bb.Task):
        def observe(self, robots):
            seen["observed"] = robots.body_rate.copy()
            return robots.body_rate

        def reward(self, robots):
            seen["true"] = robots.body_rate.copy()
            return np.zeros(len(robots))

    bb.register("me/Watch-v0", Watch)
    options = {"sensors": {"gyro_noise": 0.01}, "observation": "sensors", "model": "contact"}
    env = bb.BallbotVectorEnv(2, task="me/Watch-v0", **options)
    env.reset(seed=0)
    env.step(np.zeros((2, 3)))
    true = np.array([state.body_angular_velocity for state in env.state])
    np.testing.assert_allclose(seen["true"], true, atol=1e-6)
    assert np.abs(seen["observed"] - true).max() > 1e-3


def test_controllers_run_and_are_compared_on_it():
    class Stand(Spin):
        def terminated(self, robots):
            return robots.tilt > 0.5

    bb.register("me/Stand-v0", Stand)
    result = bb.evaluate("lqr", task="me/Stand-v0", episodes=5, seed=3, reset_yaw=0.0)
    assert result.survival_rate == 1.0
    assert result.mean_reward == pytest.approx(-1.0, abs=0.1)


@pytest.mark.parametrize(
    ("method", "value", "message"),
    [
        ("observe", lambda robots: np.zeros(len(robots)), r"Wrong.observe returned shape \(1,\), expected \(1, k\)"),
        ("reward", lambda _: 1.0, r"reward returned shape \(\), expected \(2,\)"),
        ("reward", lambda robots: np.full(len(robots), np.nan), r"reward returned nan at \(0,\), expected finite"),
        ("reward", lambda _: np.array(["a", "b"]), "expected numbers"),
        ("reward", lambda _: np.ma.masked_all(2), "reward returned a masked array: expected numbers, fill it first"),
        ("reward", lambda _: [np.ma.masked, 0.0], "reward returned a masked array"),
        ("terminated", lambda robots: np.ma.masked_array(robots.tilt > 1.0), "a masked array: expected bool"),
        ("observe", lambda robots: robots.gravity.astype(str), "of dtype <U32: expected numbers"),
        ("observation_bound", "1", "observation_bound of Wrong is '1': expected numbers"),
        ("terminated", lambda robots: np.zeros(len(robots)), "dtype float64: expected bool"),
        ("terminated", lambda robots: np.zeros((len(robots), 1), dtype=bool), r"expected \(2,\) for 2 robots"),
        ("observation_bound", -1.0, "must be finite and above 0"),
        ("observation_bound", [1.0, 2.0], r"has shape \(2,\), expected \(\) or \(9,\)"),
    ],
)
def test_errors_name_class_method_and_shape(method, value, message):
    wrong = type("Wrong", (Spin,), {method: (lambda _, robots: value(robots)) if callable(value) else value})

    def use():
        bb.register("me/Wrong-v0", wrong)
        env = bb.BallbotVectorEnv(2, task="me/Wrong-v0", model="contact")
        env.reset(seed=0)
        env.step(np.zeros((2, 3)))

    with pytest.raises((ValueError, TypeError), match=message):
        use()


def test_registration_is_checked():
    with pytest.raises(TypeError, match="subclass of Task"):
        bb.register("me/Odd-v0", object)
    with pytest.raises(ValueError, match="choose another id"):
        bb.register("ballbot/Balance-v0", Spin)
    with pytest.raises(ValueError, match="id of an environment"):
        bb.register("no id at all!", Spin)
    with pytest.raises(ValueError, match=r"did you mean 'me/Spin-v0'"):
        bb.BallbotVectorEnv(2, task="me/Spn-v0")
    with pytest.raises(TypeError, match="distanse"):
        bb.BallbotVectorEnv(2, task="me/Chase-v0", distanse=1.0)
    pytest.importorskip("stable_baselines3")
    with pytest.raises(TypeError, match="give one of the two"):
        bb.BallbotVecEnv("me/Spin-v0", task="balance")
    assert "me/Spin-v0" not in TASKS


@pytest.mark.parametrize("name", ["control_dt", "robot", "terrain", "model", "seed", "num_envs", "fall_tilt"])
def test_an_argument_of_a_task_with_the_name_of_an_option_is_rejected(name):
    class Counts(Spin):
        pass

    namespace = {}
    exec(f"def __init__(self, {name}=None): pass", namespace)
    Counts.__init__ = namespace["__init__"]
    with pytest.raises(ValueError, match=f"Counts has an argument '{name}', which is an option of every environment"):
        bb.register("me/Counts-v0", Counts)


def test_names_of_all_front_ends_are_taken():
    makers = [bb.BallbotEnv, bb.BallbotVectorEnv, gymnasium.make, gymnasium.make_vec, bb.register]
    if importlib.util.find_spec("stable_baselines3"):
        makers.append(bb.BallbotVecEnv)
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.POSITIONAL_ONLY)
    names = {p.name for make in makers for p in inspect.signature(make).parameters.values() if p.kind not in kinds}
    assert names <= {*TAKEN, *option_names("me/Spin-v0")}


def test_a_blank_docstring_and_no_time_limit():
    class Blank(Spin):
        """ """

        max_episode_steps = None

        def terminated(self, robots):
            return np.zeros(len(robots), dtype=bool)

    bb.register("me/Blank-v0", Blank)
    assert description_of("me/Blank-v0")["summary"] == "Blank"
    assert gymnasium.spec("me/Blank-v0").max_episode_steps is None
    env = bb.BallbotVectorEnv(1, task="me/Blank-v0", model="contact")
    assert env.task_options["max_episode_steps"] is None
    limited = bb.BallbotVectorEnv(1, task="me/Blank-v0", model="contact", max_episode_steps=3)
    limited.reset(seed=0)
    assert [limited.step(np.zeros((1, 3)))[3][0] for _ in range(3)] == [False, False, True]


def test_observations_beyond_float32_are_clipped():
    class Huge(Spin):
        def observe(self, robots):
            return np.full((len(robots), 2), (1e300, -1e300))

    bb.register("me/Huge-v0", Huge)
    env = bb.BallbotEnv("me/Huge-v0", model="contact")
    observation, _ = env.reset(seed=0)
    assert observation.dtype == np.float32
    np.testing.assert_array_equal(observation, [1000.0, -1000.0])


def test_the_tilt_of_a_fall_matches_the_task():
    with pytest.raises(ValueError, match="fall_tilt: the method `terminated`"):
        bb.BallbotEnv("me/Spin-v0", fall_tilt=0.3)


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
@pytest.mark.parametrize("method", ["reward", "terminated", "observe", "reset"])
def test_after_an_exception_the_next_episode_begins_properly(mode, method):
    """A method raises in the step that ends an episode: the task still begins the next episode."""
    begun = []

    class Raises(Spin):
        armed = False

        def reset(self, robots, chosen, rngs):  # noqa: ARG002
            self.fail("reset")
            begun.extend(chosen.tolist())

        def observe(self, robots):
            self.fail("observe")
            return np.column_stack([robots.gravity, robots.time])

        def reward(self, robots):
            self.fail("reward")
            return np.zeros(len(robots))

        def terminated(self, robots):
            self.fail("terminated")
            return np.zeros(len(robots), dtype=bool)

        def fail(self, name):
            if self.armed and name == method:
                raise RuntimeError("not now")

    bb.register("me/Raises-v0", Raises)
    options = {"task": "me/Raises-v0", "model": "contact", "max_episode_steps": 3, "autoreset_mode": mode}
    env = bb.BallbotVectorEnv(2, **options)
    env.reset(seed=0)
    still = np.zeros((2, 3))
    for _ in range(2):
        env.step(still)

    def end_and_begin():
        env.step(still)
        if mode == "disabled":
            env.reset(options={"reset_mask": np.ones(2, dtype=bool)})
        else:
            env.step(still)

    env._batch.stage.task.armed = True
    with pytest.raises(RuntimeError, match="not now"):
        end_and_begin()
    env._batch.stage.task.armed = False
    begun.clear()
    with pytest.raises(ValueError, match="reset"):
        env.step(still)
    observations, _ = env.reset()
    assert begun == [0, 1]
    np.testing.assert_array_equal(observations[:, 3], 0.0)
    for step in (1, 2):
        np.testing.assert_allclose(env.step(still)[0][:, 3], 0.01 * step, rtol=1e-6)


def test_last_observations_are_in_the_infos_of_every_mode():
    for mode in ("same_step", "next_step", "disabled"):
        for task in ("me/Spin-v0", "balance"):
            options = {"max_episode_steps": 3, "model": "contact"}
            batch = new_batch(3, task=task, autoreset=mode, seed=1, options=options)
            batch.reset()
            for step in range(3):
                observations, _, _, truncated = batch.step(actions(step, 3))
            assert truncated.all()
            last = np.array([info["terminal_observation"] for info in batch.infos()])
            np.testing.assert_array_equal(last, batch.final_observations())
            if mode == "same_step":
                other = new_batch(3, task=task, autoreset="disabled", seed=1, options={"model": "contact"})
                other.reset()
                for step in range(3):
                    observations = other.step(actions(step, 3))[0]
            np.testing.assert_array_equal(last, observations)
            assert np.abs(last).max() > 0.0


def test_arrays_are_views_and_read_only():
    held = {}

    class Keep(Spin):
        def observe(self, robots):
            held["robots"] = robots
            return super().observe(robots)

    bb.register("me/Keep-v0", Keep)
    env = bb.BallbotVectorEnv(4, task="me/Keep-v0", model="contact", autoreset_mode="disabled")
    env.reset(seed=0)
    env.step(np.zeros((4, 3)))
    robots = held["robots"]
    assert robots.gravity.base is robots.wheel_speeds.base is not None
    assert (robots.gravity.shape, robots.body_quaternion.shape, len(robots)) == ((4, 3), (4, 4), 4)
    names = [name for name in dir(robots) if isinstance(getattr(robots, name), np.ndarray) and name[0] != "_"]
    assert {"numbers", "steps", "time", "tilt", "yaw", "yaw_rate", "velocity", "gravity"} <= set(names)
    for name in names:
        array = getattr(robots, name)
        assert not array.flags.writeable, name
        # Nor through the array that it is a view of.
        assert array.base is None or not array.base.flags.writeable, name
    expected = [state.yaw for state in env.state]
    np.testing.assert_allclose(robots.yaw, expected, atol=1e-5)
    np.testing.assert_allclose(robots.tilt, [state.tilt for state in env.state], atol=1e-4)


def test_the_tutorial_runs():
    pytest.importorskip("stable_baselines3")
    text = (ROOT / "docs" / "own_tasks.md").read_text(encoding="utf-8")
    space = {}
    for block in re.findall(r"^```python\n(.+?)^```$", text, flags=re.DOTALL | re.MULTILINE):
        exec(compile(block.replace("10_000", "2_048"), "own_tasks.md", "exec"), space)
        env = space["env"]
        env.reset()
    assert space["model"].num_timesteps == 2048
    observations, *_ = space["env"].step(np.zeros((64, 3)))
    assert observations.shape == (64, 9)


def test_seeds_of_the_constructor_and_of_reset_are_the_same():
    first, _ = bb.BallbotVectorEnv(3, task="me/Chase-v0", model="contact", seed=7).reset()
    again, _ = bb.BallbotVectorEnv(3, task="me/Chase-v0", model="contact").reset(seed=7)
    np.testing.assert_array_equal(first, again)


def test_snapshots_keep_that_the_task_has_ended_an_episode():
    class Short(Spin):
        def terminated(self, robots):
            return robots.steps >= 3

    bb.register("me/Short-v0", Short)
    options = {"task": "me/Short-v0", "model": "contact", "autoreset_mode": "next_step"}
    env, other = bb.BallbotVectorEnv(2, **options), bb.BallbotVectorEnv(2, **options)
    for each in (env, other):
        each.reset(seed=0)
    for step in range(3):
        env.step(actions(step, 2))
    for i in range(2):
        other._batch.restore(i, env._batch.snapshot(i))
    np.testing.assert_array_equal(env.step(actions(3, 2))[0], other.step(actions(3, 2))[0])


def test_the_tilt_follows_the_present_robot():
    tilts = []

    class Tilt(Spin):
        def terminated(self, robots):
            tilts.append(robots.tilt[0])
            return np.zeros(len(robots), dtype=bool)

    bb.register("me/Tilt-v0", Tilt)
    env = bb.BallbotEnv("me/Tilt-v0", model="contact")
    params = bb.Params.paper().replace(body_com_offset=(0.02, 0.0))
    env.set_params(params)
    env.reset(seed=0)
    same = bb.BallbotEnv("me/Tilt-v0", model="contact", robot=params)
    same.reset(seed=0)
    for each in (env, same):
        each.step(np.zeros(3))
    expected = tilt_of(env.state.to_array(), params.body_com)
    assert tilts[0] == tilts[1] == pytest.approx(expected, abs=1e-4)
    assert abs(expected - env.state.tilt) > 1e-3


def test_policies_are_saved_and_compared(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    env = bb.BallbotVecEnv("me/Chase-v0", num_envs=4, model="contact", distance=0.25)
    assert env.task_options["distance"] == 0.25
    model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=32, n_epochs=1, device="cpu").learn(32)
    file = bb.save(model, tmp_path / "chase")
    result = bb.evaluate(str(file), task="me/Chase-v0", episodes=2)
    assert result.episodes == 2


def test_a_failed_registration_changes_nothing():
    class Bad(Spin):
        def observe(self, robots):  # noqa: ARG002
            raise RuntimeError("not yet")

    for env_id in ("me/Spin-v0", "me/Bad-v0"):
        with pytest.raises(RuntimeError, match="not yet"):
            bb.register(env_id, Bad)
    assert gymnasium.make("me/Spin-v0").unwrapped.reset(seed=0)[0].shape == (9,)
    with pytest.raises(gymnasium.error.NameNotFound):
        gymnasium.make("me/Bad-v0")
    with pytest.raises(ValueError, match="unknown task 'me/Bad-v0'"):
        bb.BallbotEnv("me/Bad-v0")
    bb.register("me/Long-v0", Spin, max_episode_steps=None, robot=bb.Params.paper().to_dict())
    assert bb.BallbotEnv("me/Long-v0").reset(seed=0)[0].shape == (9,)
    with pytest.raises(TypeError, match="fool"):
        bb.register("me/Odd-v0", Spin, fool=1)


def test_arrays_of_a_step_are_fresh():
    class Buffer(Spin):
        def reward(self, robots):
            if not hasattr(self, "kept"):
                self.kept = np.zeros(len(robots))
            self.kept[:] = robots.steps
            return self.kept

    bb.register("me/Buffer-v0", Buffer)
    env = bb.BallbotVectorEnv(2, task="me/Buffer-v0", model="contact", autoreset_mode="disabled")
    first, _ = env.reset(seed=0)
    kept = first.copy()
    first[:] = 9.0
    rewards = [env.step(np.zeros((2, 3)))[1] for _ in range(2)]
    np.testing.assert_array_equal(rewards, [[1.0, 1.0], [2.0, 2.0]])
    again, _ = env.reset(seed=0)
    np.testing.assert_array_equal(again, kept)
