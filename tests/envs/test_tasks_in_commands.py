"""A task in a file of a user: trained, evaluated, recorded, plotted, viewed and exported by the commands."""

import json
import pickle
import sys
import types

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.deployment import policy_header
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.own.source import is_in_source
from ballbot_rs.viewer.session import Session
from tests.support.c_code import CPolicy
from tests.support.in_process import parse_json, run
from tests.support.tiny_config import TINY_CONFIG

FILE = """\
import numpy as np

import ballbot_rs as bb

AXES = ("x", "y", "z")


class Turn(bb.Task):
    \"\"\"Turn at 2 rad/s.\"\"\"

    max_episode_steps = 50
    units = {"turn_error": "rad/s"}
    row_names = (
        *(f"gravity direction, body {axis}" for axis in AXES),
        *(f"body rate about body {axis}" for axis in AXES),
        *(f"wheel speed {i}" for i in range(3)),
    )

    def observe(self, robots):
        return np.column_stack([robots.gravity, robots.body_rate, robots.wheel_speeds])

    def reward(self, robots):
        return 1.0 - np.abs(robots.yaw_rate - 2.0)

    def terminated(self, robots):
        return robots.tilt > 0.4

    def success(self, robots):
        return robots.steps >= 10

    def metrics(self, robots):
        return {"turn_error": np.abs(robots.yaw_rate - 2.0)}


class Gentle(bb.Task):
    base = "velocity"

    def reward(self, robots):
        return -np.linalg.norm(robots.velocity - robots.command[:, :2], axis=1)

    def metrics(self, robots):
        return {"effort": np.mean(robots.last_action**2, axis=1)}


bb.register("user/Turn-v0", Turn)
bb.register("user/Gentle-v0", Gentle)
"""


@pytest.fixture
def task(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "turns.py").write_text(FILE, encoding="utf-8")
    return "turns.py:user/Turn-v0"


@pytest.mark.slow("a training, a video and figures")
def test_from_a_reward_to_a_microcontroller(task, tmp_path, capsys):
    for name in ("stable_baselines3", "onnx", "onnxruntime", "matplotlib", "viser"):
        pytest.importorskip(name)
    (tmp_path / "tiny.toml").write_text(
        TINY_CONFIG.replace("ballbot/Balance-v0", "user/Turn-v0").replace("spatial", "contact"), encoding="utf-8"
    )
    code, out, err = run(capsys, "train", task, "--config", "tiny.toml", "--run", "run", "--episodes", 0)
    assert code == 0, err
    assert f"ballbot view {task} --controller run" in out
    assert (tmp_path / "run" / "report.html").is_file()
    code, out, err = run(capsys, "evaluate", task, "--controller", "run", "--episodes", 3, "--json")
    assert code == 0, err
    (result,) = parse_json(out)["results"]
    assert set(result["metrics"]) == {"turn_error"}
    size = ("--size", 64, 48, "--seconds", 0.2)
    assert run(capsys, "record", task, "--controller", "run", "-o", "a.webp", *size)[0] == 0
    plot = ("plot", task, "--controller", "run", "--seconds", 0.5, "--figure", "trajectories", "-o", "figures")
    assert run(capsys, *plot)[0] == 0
    page = ("view", task, "--controller", "run", "--no-open", "--seconds", 1, "--port", 18975)
    code, out, err = run(capsys, *page)
    assert code == 0, err
    assert "user/Turn-v0, 1 robot paper" in out

    assert run(capsys, "export", "run", "--task", task, "-o", "p.onnx")[0] == 0
    assert run(capsys, "export", "p.onnx", "--task", task, "-o", "p.h")[0] == 0
    policy = OnnxPolicy("p.onnx")
    text = (tmp_path / "p.h").read_text(encoding="ascii")
    assert text == policy_header("p.onnx")
    in_c = CPolicy(tmp_path, text)
    rows = np.random.default_rng(0).normal(size=(200, 9)).astype(np.float32)
    np.testing.assert_allclose(in_c.act(rows), policy.act(rows), atol=1e-6)
    # The named rows are computed in C, as `observe` computes them.
    env = bb.BallbotEnv("user/Turn-v0", model="contact")
    observation, _ = env.reset(seed=3)
    np.testing.assert_allclose(in_c.observe(env.state), observation, atol=1e-6)


def turn_error(state):
    """Of a nearly upright robot."""
    w, x, y, z = state.body_quaternion
    up = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
    return abs(up @ state.body_angular_velocity - 2.0)


def test_every_function_takes_a_task_with_its_source(task):
    short = {"max_episode_steps": 20}
    assert bb.rollout("lqr", 2, task=task, seconds=0.1).upright.all()
    assert bb.record_dataset("lqr", episodes=2, task=task, **short).env_id == "ballbot_rs:user/Turn-v0"
    assert bb.simulate("lqr", task=task, seconds=0.1).fell_at is None
    assert bb.evaluate("lqr", episodes=2, task=task, **short).survival_rate == 1.0


def test_metrics_are_means_over_the_steps_of_an_episode(task):
    n = 5
    env = bb.BallbotVectorEnv(n, task=task, model="contact", max_episode_steps=30, autoreset_mode="same_step")
    env.reset(seed=0)
    errors = []
    for step in range(30):
        if step == 10:
            env = pickle.loads(pickle.dumps(env))
        *_, infos = env.step(0.2 * np.sin(np.arange(3 * n).reshape(n, 3) + step))
        errors.append([turn_error(state) for state in env.state])
        if step < 29:
            np.testing.assert_allclose(infos["turn_error"], np.mean(errors, axis=0), rtol=1e-5)
    # The states of the last step are of the next episodes.
    final = infos["final_info"]["turn_error"]
    np.testing.assert_allclose(env.metrics()["turn_error"], final)
    assert (np.abs(final - np.mean(errors[:-1], axis=0)) < 0.1).all()
    np.testing.assert_array_equal(infos["turn_error"], 0.0)
    batch = bb.BallbotVecEnv(task, num_envs=2, model="contact", max_episode_steps=3)
    batch.reset()
    for _ in range(3):
        *_, dones, infos = batch.step(np.zeros((2, 3)))
    assert dones.all()
    assert all(abs(info["turn_error"] - 2.0) < 0.5 for info in infos)


def test_a_task_on_a_base_has_its_commands_and_metrics(task):
    gentle = task.replace("Turn", "Gentle")
    env = bb.BallbotEnv(gentle, model="contact")
    plain = bb.BallbotEnv("velocity", model="contact")
    np.testing.assert_array_equal(env.reset(seed=1)[0], plain.reset(seed=1)[0])
    env.command = plain.command = (0.2, 0.1, 0.0)
    _, reward, *_, info = env.step(np.zeros(3))
    plain.step(np.zeros(3))
    assert env.state == plain.state
    yaw = env.state.yaw
    command = [0.2 * np.cos(yaw) - 0.1 * np.sin(yaw), 0.2 * np.sin(yaw) + 0.1 * np.cos(yaw)]
    assert reward == pytest.approx(-np.linalg.norm(env.state.ball_velocity[:2] - command), abs=1e-5)
    assert set(info) >= {"velocity_error", "yaw_rate_error", "effort"}
    found = bb.evaluate("lqr", task=gentle, episodes=2, max_episode_steps=600)
    assert found.success_rate == 1.0
    assert found.metrics["velocity_error"] < 0.05
    assert 0.0 < found.metrics["effort"] < 0.1

    session = Session(task=gentle.rpartition(":")[2])
    session.drive(1.0, 0.0, 0.0)
    for _ in range(200):
        session.step()
    frame = session.frame()
    assert frame.commands.values[0] == pytest.approx([session.commanding.max_speed, 0.0, 0.0])
    assert frame.states[0, 7:9] == pytest.approx(frame.commands.values[0, :2], abs=0.1)
    assert set(frame.commands.metrics) == set(info) - {"is_success", "termination"}


def test_the_page_continues_where_the_task_ends_an_episode(task):
    class Brief(bb.Task):
        def observe(self, robots):
            return robots.gravity

        def reward(self, robots):
            return robots.time

        def terminated(self, robots):
            return robots.steps >= 20

    assert task
    bb.register("user/Brief-v0", Brief)
    session = Session(task="user/Brief-v0")
    for _ in range(101):
        session.step()
    assert session.robots.episodes == [6]
    assert not session.robots.fallen.any()
    assert session.frame().time == pytest.approx(1.01)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("turns.py:user/Turns-v0", "turns.py does not register 'user/Turns-v0' by bb.register: did you mean 'user/Tur"),
        ("nowhere.py:user/Turn-v0", "nowhere.py failed: FileNotFoundError"),
        ("broken.py:user/Turn-v0", "broken.py failed: ZeroDivisionError: division by zero"),
        ("no_such_module:user/Turn-v0", "no_such_module failed: ModuleNotFoundError"),
    ],
)
def test_a_wrong_source_is_named(task, name, message, tmp_path, capsys):
    assert run(capsys, "evaluate", task, "--episodes", 1, "--quiet")[0] == 0
    (tmp_path / "broken.py").write_text("1 / 0\n", encoding="utf-8")
    with pytest.raises(bb.InvalidInputError) as raised:
        bb.BallbotEnv(name)
    assert message in str(raised.value)
    code, _, err = run(capsys, "evaluate", name)
    assert code == 2
    assert message in err


def test_only_names_of_modules_and_files_are_sources():
    for name in ("a.py:me/A-v0", "folder/a.py:A-v0", "pack.mod:me/A-v0", "/folder/a.py:A"):
        assert is_in_source(name), name
    for name in (
        "me/A-v0",
        "balance",
        "C:\\a.onnx",
        "C:/a/b.onnx",
        "serial:/dev/ttyUSB0",
        "udp://host:9000",
        "a.py:",
        "1a:A",
    ):
        assert not is_in_source(name), name


def test_a_file_runs_once_for_each_version(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "turn_counter", counter := types.SimpleNamespace(loads=0))
    file = tmp_path / "counting.py"
    file.write_text("import turn_counter\nturn_counter.loads += 1\n" + FILE, encoding="utf-8")
    for _ in range(2):
        bb.BallbotEnv(f"{file}:user/Turn-v0")
    assert counter.loads == 1
    file.write_text(file.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    bb.BallbotEnv(f"{file}:user/Turn-v0")
    assert counter.loads == 2


def test_the_list_has_imported_tasks(task, capsys):
    code, out, _ = run(capsys, "--import", task.partition(":")[0], "list", "tasks", "--json")
    assert code == 0
    assert json.loads(out)["tasks"]["user/Turn-v0"] == "Turn at 2 rad/s."


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"base": "hover"}, r"base = 'hover' of Wrong is not a task of the core"),
        ({"row_names": ("one",)}, r"row_names of Wrong has \['one'\], expected 3 different names"),
        ({"metrics": lambda _, robots: robots.tilt}, r"Wrong.metrics returned .*expected a dict of numbers by name"),
        ({"metrics": lambda _, robots: {"a": robots.gravity}}, r"Wrong.metrics.a returned shape \(1, 3\)"),
        (
            {"base": "velocity", "metrics": lambda _, robots: {"velocity_error": robots.tilt}},
            "Wrong.metrics has 'velocity_error', which its base velocity has already",
        ),
    ],
)
def test_wrong_declarations_are_named(attributes, message):
    methods = {"observe": lambda _, robots: robots.gravity, "reward": lambda _, robots: robots.tilt}
    with pytest.raises(ValueError, match=message):
        bb.register("user/Wrong-v0", type("Wrong", (bb.Task,), {**methods, **attributes}))
    with pytest.raises(ValueError, match="unknown task 'user/Wrong-v0'"):
        new_batch(1, task="user/Wrong-v0")


def test_metrics_are_summarized_as_the_task_declares():
    kinds = ("mean", "rms", "max", "min", "last")

    class Kinds(bb.Task):
        summaries = {name: name for name in kinds if name != "mean"}  # noqa: RUF012

        def observe(self, robots):
            return robots.gravity

        def reward(self, robots):
            return np.zeros(len(robots))

        def metrics(self, robots):
            return dict.fromkeys(kinds, np.where(robots.steps == 2, -5.0, robots.steps))

    bb.register("user/Kinds-v0", Kinds)
    for _ in range(2):
        env = bb.BallbotEnv("user/Kinds-v0", max_episode_steps=3)
        env.reset(seed=0)
        for _ in range(3):
            *_, info = env.step(np.zeros(3))
        # Of 1, -5, 3, and of no step before.
        expected = {"mean": -1 / 3, "rms": np.sqrt(35 / 3), "max": 3.0, "min": -5.0, "last": 3.0}
        assert {name: info[name] for name in kinds} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("declared", "error", "message"),
    [
        ({"summaries": ["max"]}, TypeError, r"summaries = \['max'\]: expected a dict, one of mean, rms, .* by name"),
        ({"summaries": {"effort": ["max"]}}, ValueError, r"summaries has \['max'\] for 'effort': expected one of mean"),
        ({"summaries": {"effort": "median"}}, ValueError, "summaries has 'median' for 'effort': expected one of mean"),
        ({"summaries": {"other": "max"}}, ValueError, "for 'other': .* for one of the metrics effort"),
        ({"units": ["m"]}, TypeError, r"units = \['m'\]: expected a dict, text by name of a metric"),
        ({"units": {"effort": 1}}, ValueError, "units has 1 for 'effort': expected text for one of the metrics effort"),
        ({"units": {"other": "m"}}, ValueError, "units has 'm' for 'other': .* for one of the metrics effort"),
        (
            {"summaries": {"effort": "max"}, "metrics": bb.Task.metrics},
            ValueError,
            r"for 'effort': .* a metric, but metrics\(\) returns none",
        ),
    ],
)
def test_wrong_declarations_of_metrics_are_named(declared, error, message):
    own = {
        "observe": lambda _, robots: robots.gravity,
        "reward": lambda _, robots: robots.tilt,
        "metrics": lambda _, robots: {"effort": robots.tilt},
    }
    with pytest.raises(error, match=message):
        bb.register("user/Wrong-v0", type("Wrong", (bb.Task,), own | declared))
