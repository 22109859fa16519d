"""Functions on tasks of the core: reward terms, rows and terminations, with all that a task has."""

import copy
import importlib
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs.envs._batch_env import new_batch

TASK = "balance"


def squares(columns):
    """Sums of squares, in an order that, unlike NumPy's, does not depend on the number of robots."""
    x, y, z = columns.T
    return x * x + y * y + z * z


def energy(robots):
    return -squares(robots.wheel_speeds)


def speed(robots):
    return np.hypot(*robots.velocity.T)


def too_fast(robots):
    return speed(robots) > 0.2


class Smooth:
    """Cost of the change of the action, with a memory and random numbers."""

    def __init__(self):
        self.before, self.weight = {}, {}

    def reset(self, robots, chosen, rngs):
        assert (robots.steps == 0).all()
        for i, rng in zip(chosen.tolist(), rngs, strict=True):
            self.before[i], self.weight[i] = np.zeros(3, np.float32), rng.uniform(1.0, 2.0)

    def __call__(self, robots):
        numbers = robots.numbers.tolist()
        change = robots.last_action - np.array([self.before[i] for i in numbers])
        self.before.update(zip(numbers, robots.last_action, strict=True))
        return -np.array([self.weight[i] for i in numbers]) * squares(change)


ADDED = {
    "reward": {"energy": energy, "smooth": Smooth},
    "rows": {"speed": speed, "gravity": lambda robots: robots.gravity[:, :2]},
    "terminations": {"too_fast": too_fast},
}
OPTIONS = {"model": "contact", "max_episode_steps": 40, "reset_ball_speed": 0.25}


def actions(step, n):
    return 0.4 * np.sin(np.arange(3 * n).reshape(n, 3) * 7 + 3 * step).astype(np.float32)


def test_gymnasium_checks_the_environment():
    env = gymnasium.make("ballbot/Balance-v0", **ADDED)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (len(TASKS[TASK]["observation"]) + 3,)
    assert env.unwrapped.metadata["terminations"][-1] == "too_fast"


@pytest.mark.parametrize("options", [{}, {"history": 3}, {"scale_observations": False}, {"scan": {"points": (3, 2)}}])
@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_many_robots_equal_single_robots(mode, options):
    n = 7
    made = {**OPTIONS, **ADDED, **options}
    many = new_batch(n, task=TASK, autoreset=mode, seed=3, num_threads=2, options=made)
    alone = [new_batch(1, task=TASK, autoreset=mode, seed=3 + i, num_threads=1, options=made) for i in range(n)]
    seen = many.reset()
    for i, one in enumerate(alone):
        np.testing.assert_array_equal(one.reset()[0], seen[i])
    reasons = set()
    for step in range(100):
        seen, *results = many.step(actions(step, n))
        terms = many.reward_terms()
        # Where an episode has begun they are zero.
        running = terms.any(axis=1)
        np.testing.assert_allclose(terms[running].sum(axis=1), results[0][running], rtol=1e-12)
        final = many.final_observations()
        for i, one in enumerate(alone):
            found, *own = one.step(actions(step, n)[i : i + 1])
            np.testing.assert_array_equal(found[0], seen[i])
            assert [float(part[0]) for part in own] == [float(part[i]) for part in results]
            np.testing.assert_array_equal(one.reward_terms()[0], terms[i])
            assert one.ending(0) == many.ending(i)
            if own[1][0] or own[2][0]:
                reasons.add(one.ending(0)[1])
                np.testing.assert_array_equal(one.final_observations()[0], final[i])
                if mode == "disabled":
                    one.reset()
        if mode == "disabled" and (over := results[1] | results[2]).any():
            many.reset(over)
    assert {"too_fast", None} <= reasons


@pytest.mark.parametrize("model", ["contact", "rigid", "spatial"])
def test_the_task_itself_is_unchanged(model):
    """Its terms, rows and ends are bit-identical."""
    n = 5
    added = {**ADDED, "terminations": {"never": lambda robots: np.zeros(len(robots), bool)}}
    plain = new_batch(n, task="velocity", seed=1, options={"model": model})
    more = new_batch(n, task="velocity", seed=1, options={"model": model, **added})
    rows = plain.observation_len
    before, after = plain.reset(), more.reset()
    for step in range(60):
        np.testing.assert_array_equal(after[:, :rows], before)
        (before, rewards, *ends), (after, more_rewards, *more_ends) = (
            batch.step(actions(step, n)) for batch in (plain, more)
        )
        np.testing.assert_array_equal(ends, more_ends)
        terms = more.reward_terms()
        np.testing.assert_array_equal(terms[:, :-2], plain.reward_terms())
        running = terms.any(axis=1)
        expected = rewards + terms[:, -2:].sum(axis=1)
        np.testing.assert_allclose(more_rewards[running], expected[running], rtol=1e-12)
        np.testing.assert_array_equal(more.states(), plain.states())


def test_terms_and_rows_follow_from_the_states():
    env = bb.BallbotVectorEnv(4, task=TASK, autoreset_mode="disabled", scale_observations=False, **OPTIONS, **ADDED)
    env.reset(seed=2)
    observations, *_ = env.step(actions(0, 4))
    for i, state in enumerate(env.state):
        assert env._batch.reward_terms(i)["energy"] == pytest.approx(-np.sum(state.wheel_speeds**2), rel=1e-5)
        assert observations[i, -3] == pytest.approx(np.linalg.norm(state.ball_velocity[:2]), rel=1e-5)


def test_rows_are_of_the_readings_and_rewards_of_the_truth():
    seen = {}

    def rates(robots):
        seen["rows"] = robots.body_rate.copy()
        return robots.body_rate

    def none(robots):
        seen["reward"] = robots.body_rate.copy()
        return np.zeros(len(robots))

    options = {"sensors": {"gyro_noise": 0.01}, "observation": "sensors", "scale_observations": False}
    batch = new_batch(2, task=TASK, options={**OPTIONS, **options, "rows": {"rates": rates}, "reward": {"none": none}})
    batch.reset()
    observations, *_ = batch.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(observations[:, -3:], seen["rows"])
    true = [batch.state(i).body_angular_velocity for i in range(2)]
    np.testing.assert_allclose(seen["reward"], true, rtol=1e-6, atol=1e-9)
    assert np.abs(seen["rows"] - seen["reward"]).max() > 1e-3
    np.testing.assert_array_equal(batch.privileged_observations()[:, -3:], seen["reward"])
    np.testing.assert_array_equal(batch.privileged_observations(1)[-3:], seen["reward"][1])


def test_the_command_of_the_task_is_given():
    commands = []

    def see(robots):
        commands.append(robots.command.copy())
        return np.zeros(len(robots))

    batch = new_batch(3, task="velocity", options={"reward": {"see": see}})
    batch.reset()
    batch.step(np.zeros((3, 3)))
    np.testing.assert_array_equal(commands[-1], batch.command())
    assert np.abs(commands[-1]).max() > 0.0


def test_a_copy_continues_as_the_original():
    env = bb.BallbotVectorEnv(
        3, task=TASK, **OPTIONS, reward={"smooth": Smooth, "energy": energy}, rows={"speed": speed}
    )
    env.reset(seed=5)
    for step in range(15):
        env.step(actions(step, 3))
    copied = pickle.loads(pickle.dumps(env))
    for step in range(60):
        for found, expected in zip(copied.step(actions(step, 3))[:4], env.step(actions(step, 3))[:4], strict=True):
            np.testing.assert_array_equal(found, expected)


FRONT_ENDS = [
    bb.BallbotEnv,
    lambda **options: bb.BallbotVectorEnv(1, **options),
    lambda **options: bb.BallbotVecEnv(1, **options),
]


def pickled(env):
    return pickle.loads(pickle.dumps(env))


def rewards(env, n=8):
    shape = (3,) if isinstance(env, bb.BallbotEnv) else (1, 3)
    return [float(np.squeeze(env.step(actions(step, 1).reshape(shape))[1])) for step in range(n)]


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])
@pytest.mark.parametrize("make", FRONT_ENDS)
def test_a_copy_has_a_separate_memory(make, copied):
    env = make(**OPTIONS, reward={"smooth": Smooth})
    env.reset()
    rewards(env, 3)
    kept = pickle.dumps(env)
    twin = copied(env)
    assert rewards(twin) == rewards(pickle.loads(kept))
    # Steps of the copy have changed nothing in the original.
    assert rewards(env) == rewards(pickle.loads(kept))
    twin.grade = "easy"
    assert not hasattr(env, "grade")


class Breaks:
    """Fails while `broken` has an element."""

    broken: list = []  # noqa: RUF012

    def __call__(self, robots):
        if self.broken:
            raise ValueError("not now")
        return np.zeros(len(robots))


@pytest.fixture
def broken():
    yield Breaks.broken
    Breaks.broken.clear()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])
@pytest.mark.parametrize("make", FRONT_ENDS)
def test_a_copy_after_an_exception_is_reset_first(make, copied, broken):
    env = make(**OPTIONS, reward={"breaks": Breaks})
    env.reset()
    assert not copied(env)._batch.is_interrupted
    broken.append(True)
    with pytest.raises(ValueError, match="not now"):
        rewards(env)
    broken.clear()
    twin = copied(env)
    for each in (env, twin):
        with pytest.raises(ValueError, match="reset all environments"):
            rewards(each)
        each.reset()
    assert rewards(twin) == rewards(env)


def test_a_command_whose_rows_fail_requires_a_reset(broken):
    batch = new_batch(3, task="velocity", options={"rows": {"breaks": Breaks}})
    batch.reset()
    broken.append(True)
    with pytest.raises(ValueError, match="not now"):
        batch.set_command(1, [0.1, 0.0, 0.0])
    broken.clear()
    with pytest.raises(ValueError, match="reset all environments"):
        batch.step(np.zeros((3, 3)))
    batch.reset()
    batch.step(np.zeros((3, 3)))


def test_commanding_or_reading_a_robot_computes_only_its_rows():
    called = []

    def see(robots):
        called.append(robots.numbers.tolist())
        return robots.command

    batch = new_batch(
        20, task="velocity", options={"model": "contact", "scale_observations": False, "rows": {"c": see}}
    )
    before = batch.reset()
    for i in (0, 7, 8, 17, 19):
        called.clear()
        command = np.array([0.01 * i, 0.1, -0.2], np.float32)
        batch.set_command(i, command)
        assert batch.privileged_observations(i)[-3:].tolist() == command.tolist()
        assert called == [[i], [i]]
        before[i] = batch.observations()[i]
        assert before[i, -3:].tolist() == command.tolist()
        np.testing.assert_array_equal(batch.observations(), before)


def test_rollouts_in_the_core_have_them():
    law = bb.Lqr()
    options = {**OPTIONS, "model": "spatial", **ADDED, "terminations": {}}
    batch = new_batch(2, task=TASK, seed=4, options=options)
    batch.reset()
    found = batch.rollout(law, 30, record=("rewards", "observations"))
    other = new_batch(2, task=TASK, seed=4, options=options)
    other.reset()
    law = bb.Lqr()
    for step in range(30):
        observations, rewards, _, _ = other.step(other.control(law))
        np.testing.assert_array_equal(found["rewards"][step], rewards)
        np.testing.assert_array_equal(found["observations"][step + 1], observations)


def test_options_are_json_and_make_the_same_environment():
    env = bb.BalanceEnv(reward={"tilt": 2.0, "energy": energy}, rows={"speed": f"{__name__}:speed"}, history=2)
    options = env.task_options
    assert options["reward"]["energy"] == f"{__name__}:energy"
    assert options["reward"]["tilt"] == 2.0
    assert options["rows"] == {"speed": f"{__name__}:speed"}
    again = bb.BalanceEnv(**options)
    assert again.task_options == options
    np.testing.assert_array_equal(again.reset(seed=1)[0], env.reset(seed=1)[0])
    action = np.full(3, 0.3, np.float32)
    np.testing.assert_array_equal(again.step(action)[0], env.step(action)[0])
    assert again.step(action)[1] == env.step(action)[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"reward": {"tilt": energy}}, "there is a reward term 'tilt' already"),
        ({"terminations": {"tilt": too_fast}}, "there is a termination 'tilt' already"),
        ({"rows": {"last action, wheel 0": speed}}, "there is a observation row 'last action, wheel 0' already"),
        ({"rows": speed}, "rows is of type function, expected a dict of functions by name"),
        ({"rows": {"speed": 1.0}}, "rows.speed = 1.0: expected a function"),
        ({"rows": {"speed": "nowhere"}}, "rows.speed = 'nowhere': expected a function of robots, or its name"),
        ({"rows": {"speed": "no.such.module:f"}}, "rows.speed = 'no.such.module:f' cannot be imported"),
        ({"rows": {"speed": "math:nothing"}}, "cannot be imported: module 'math' has no attribute"),
        ({"rows": {"speed": lambda _: 1.0}}, r"rows.speed returned shape \(\), expected \(2,\) or \(2, k\)"),
        ({"reward": {"energy": lambda _: np.zeros(3)}}, r"reward.energy returned shape \(3,\), expected \(2,\)"),
        ({"reward": {"energy": lambda _: [np.nan, 0.0]}}, r"reward.energy returned nan at \(0,\)"),
        ({"reward": {"energy": lambda _: [[1, 2], [3]]}}, "reward.energy returned"),
        ({"terminations": {"now": energy}}, "terminations.now returned an array of dtype float32: expected bool"),
        ({"reward": {"energy": "math:pi"}}, "reward.energy = 3.14.*: expected a function"),
        ({"reward": {"no term": 1.0}}, "no term"),
    ],
)
def test_errors_name_the_function(options, message):
    def use():
        env = bb.BallbotVectorEnv(2, task=TASK, **options)
        env.reset(seed=0)
        env.step(np.zeros((2, 3)))

    with pytest.raises((ValueError, TypeError), match=message):
        use()


def test_after_an_exception_all_environments_are_reset():
    broken = []

    def fails(robots):
        if broken:
            raise RuntimeError("not now")
        return np.zeros(len(robots))

    env = bb.BallbotVectorEnv(2, task=TASK, reward={"fails": fails})
    env.reset(seed=0)
    broken.append(True)
    with pytest.raises(RuntimeError, match="not now"):
        env.step(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="reset"):
        env.step(np.zeros((2, 3)))
    broken.clear()
    first, _ = env.reset(seed=0)
    np.testing.assert_array_equal(first, bb.BallbotVectorEnv(2, task=TASK).reset(seed=0)[0])
    env.step(np.zeros((2, 3)))


def test_using_a_batch_within_its_step_is_rejected():
    held = {}

    def looks(robots):
        held["batch"].states()
        return np.zeros(len(robots))

    held["batch"] = batch = new_batch(2, task=TASK, options={"reward": {"looks": looks}})
    batch.reset()
    with pytest.raises(RuntimeError):
        batch.step(np.zeros((2, 3)))


def test_policies_keep_their_functions(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    env = bb.BallbotVecEnv(TASK, num_envs=8, rows={"speed": f"{__name__}:speed"}, reward={"energy": energy}, seed=0)
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=64, n_epochs=1, device="cpu").learn(128)
    bb.save(model, tmp_path / "policy.zip")
    (result,) = bb.compare([tmp_path / "policy.zip"], task=TASK, episodes=2)
    assert result.episodes == 2


@pytest.mark.parametrize("options", [{}, {"history": 2}, {"observation": "sensors", "sensors": {"gyro_noise": 0.01}}])
@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_rows_show_the_command_as_the_rows_of_the_task_do(mode, options):
    made = {"command_seconds": [0.05, 0.05], "settling": 0.02, "scale_observations": False, **options}
    rows = {"command": lambda robots: robots.command}
    env = new_batch(5, task="velocity", autoreset=mode, options={**made, "rows": rows})
    plain = new_batch(5, task="velocity", autoreset=mode, options=made)
    names = [row["name"] for row in TASKS["velocity"]["observation"]]
    of_task = [i for i, name in enumerate(names) if name.startswith("command")]
    width, commands = len(names) + 3, set()
    assert len(of_task) == 3

    def check(observations, expected):
        for k in range(env.history):
            part = observations[:, k * width : (k + 1) * width]
            np.testing.assert_array_equal(part[:, of_task], part[:, -3:])
            before = expected[:, k * len(names) : (k + 1) * len(names)]
            np.testing.assert_array_equal(part[:, :-3], before)
        commands.update(observations[:, -3].tolist())

    check(env.reset(), plain.reset())
    for step in range(60):
        over = env.step(actions(step, 5)), plain.step(actions(step, 5))
        check(over[0][0], over[1][0])
        check(env.observations(), plain.observations())
        if step % 9 == 8:
            for batch in (env, plain):
                batch.set_command(2, [0.1, 0.02 * step / 60, 0.3])
            check(env.observations(), plain.observations())
        if mode == "disabled" and (ended := over[0][2] | over[0][3]).any():
            check(env.reset(ended), plain.reset(ended))
    assert len(commands) > 20


def test_what_rebuilds_another_function_is_an_error():
    class Holder:
        def term(self, robots):
            return np.zeros(len(robots))

    for function in (lambda robots: robots.yaw, Holder().term):
        options = bb.BalanceEnv(reward={"odd": function}).task_options
        with pytest.raises(ValueError, match=r"reward\.odd"):
            bb.BalanceEnv(**options)


def test_memory_in_rows_and_huge_terms_are_rejected():
    with pytest.raises(ValueError, match=r"rows\.smooth keeps state"):
        bb.BalanceEnv(rows={"smooth": Smooth})
    env = bb.BalanceEnv(reward={"huge": lambda robots: np.full(len(robots), -1e10)})
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"reward.huge returned -1e\+10, expected numbers within ±1e\+09"):
        env.step(np.zeros(3))


def test_an_added_termination_is_a_failure():
    class Won(bb.Task):
        def observe(self, robots):
            return robots.gravity

        def reward(self, robots):
            return np.zeros(len(robots))

        def success(self, robots):
            return np.ones(len(robots), bool)

    bb.register("me/Won-v0", Won)
    env = bb.BallbotEnv("me/Won-v0", terminations={"third": lambda robots: robots.steps >= 3})
    env.reset(seed=0)
    ends = [env.step(np.zeros(3))[2:] for _ in range(3)]
    assert [end[0] for end in ends] == [False, False, True]
    assert [end[2]["is_success"] for end in ends] == [True, True, False]


def test_policies_with_rows_in_another_order_are_not_compared(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    rows = {"speed": f"{__name__}:speed", "energy": f"{__name__}:energy"}
    files = []
    for i, order in enumerate((rows, dict(reversed(rows.items())))):
        env = bb.BallbotVecEnv(TASK, num_envs=2, rows=order, seed=0)
        files.append(tmp_path / f"{i}.zip")
        bb.save(sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu"), files[-1])
    with pytest.raises(ValueError, match="not the same task"):
        bb.compare(files, episodes=1)


def test_policy_files_select_no_code(tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    env = bb.BallbotVecEnv(TASK, num_envs=2, reward={"energy": f"{__name__}:energy"})
    bb.save(sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu"), tmp_path / "policy.zip")
    policy_file = importlib.import_module("ballbot_rs.control.policy_file")
    for name, message in [
        ("builtins:input", "is not a function of robots"),
        ("os.path:join", "is not a function of robots"),
        ("nowhere:f", "import nowhere first"),
        (f"{__name__}:np.sum", "is not of the module"),
        (
            "__main__:energy",
            r"reward.energy = '__main__:energy' .* move it to a module, name it as 'my_module:energy'.*--import",
        ),
    ]:
        with pytest.raises(ValueError, match=message):
            policy_file.completed(TASK, {"reward": {"energy": name}})


@pytest.mark.slow("trains in another process")
def test_the_command_line_imports_what_a_policy_needs(tmp_path):
    pytest.importorskip("stable_baselines3")
    (tmp_path / "my_terms.py").write_text("def none(robots):\n    return 0.0 * robots.yaw\n")

    def ballbot(*words):
        ran = subprocess.run(
            [sys.executable, "-m", "ballbot_rs", *words], cwd=tmp_path, capture_output=True, check=False
        )
        return ran.returncode, ran.stderr.decode()

    train = ("train", TASK, "--timesteps", "64", "--set", "rows.none=my_terms:none", "--run", "run")
    # So short a training fails, with a policy.
    assert "succeeds in" in ballbot("--import", "my_terms", *train)[1]
    evaluate = ("evaluate", "run", "--episodes", "1")
    assert "import my_terms first (ballbot --import MODULE COMMAND ...)" in ballbot(*evaluate)[1]
    assert ballbot("--import", "my_terms", *evaluate)[0] == 0
    assert "No module named 'nowhere'" in ballbot("--import", "nowhere", "info")[1]
