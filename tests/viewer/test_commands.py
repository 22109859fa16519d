"""Tasks in the viewer's session: commands are sampled, set by hand within the task's limits, and followed."""

import dataclasses
import math

import numpy as np
import pytest

from ballbot_rs import Controller, Params
from ballbot_rs.control.resolve import find
from ballbot_rs.viewer.session.commanding import ACCELERATION, YAW_ACCELERATION
from ballbot_rs.viewer.session.session import LIES_FOR, Session
from tests.support.onnx_policies import SHIPPED

TASKS = ("velocity", "goal", "path", "push")


def run(session, seconds):
    for _ in range(round(seconds / session.driver.control_dt)):
        session.step()


def command(session, robot=0):
    return session.frame().commands.values[robot]


@pytest.mark.parametrize("model", ["contact", "spatial"])
@pytest.mark.parametrize("task", TASKS)
def test_a_controller_acts_as_in_the_batch(task, model):
    session = Session(model, task=task, seed=5)
    batch = session.robots.setup.batch(0)
    batch.reset(starts=[session.robots.states[0]])
    np.testing.assert_array_equal(batch.command(0), command(session))
    law = Controller("lqr", None, batch.control_dt)
    commands = []
    for _ in range(700):
        batch.step(batch.control(law))
        session.step()
        commands.append(tuple(command(session)))
        np.testing.assert_array_equal(command(session), batch.command(0))
    # Actions of a batch are of single precision.
    np.testing.assert_allclose(session.frame().states[0], batch.states()[0], atol=1e-3)
    assert session.frame().commands.metrics == pytest.approx(batch.metrics(0), abs=1e-3, nan_ok=True)
    if task == "velocity":
        # Within 7 s they have been sampled more than once.
        assert len(set(commands)) > 1


@pytest.mark.parametrize(("task", "history"), [*((task, 2) for task in TASKS), ("goal", [0, 1, 4])])
def test_a_policy_brings_its_task_and_observes_as_in_training(task, history, tmp_path):
    pytest.importorskip("onnx", reason="needs 'ballbot-rs[export]'")
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    from ballbot_rs import OnnxPolicy
    from tests.support.onnx_policies import tiny_policy

    # A long way from the defaults: the environment of the page is the environment of the training.
    path = tiny_policy(tmp_path / "p.onnx", task, gain=0.03, history=history, max_wheel_torque=0.2, control_dt=0.02)
    session = Session(controller=str(path), num_robots=2)
    assert (session.task, session.driver.control_dt) == (task, 0.02)
    policy = OnnxPolicy(path)
    batches = [session.robots.setup.batch(i) for i in range(2)]
    seen = [batch.reset(starts=[state])[0] for batch, state in zip(batches, session.robots.states, strict=True)]
    for _ in range(12):
        actions = [policy.act(observation) for observation in seen]
        seen = [batch.step(action[np.newaxis])[0][0] for batch, action in zip(batches, actions, strict=True)]
        session.step()
        np.testing.assert_allclose(session.frame().torques, 0.2 * np.array(actions), rtol=1e-5)
    np.testing.assert_allclose(session.frame().states, [batch.states()[0] for batch in batches], atol=1e-5)


def test_a_policy_of_another_task_is_rejected(tmp_path):
    pytest.importorskip("onnx", reason="needs 'ballbot-rs[export]'")
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    from tests.support.onnx_policies import tiny_policy

    path = str(tiny_policy(tmp_path / "p.onnx", "goal"))
    with pytest.raises(ValueError, match="was trained for the task goal, not for the task path"):
        Session(controller=path, task="path")
    session = Session(task="path")
    session.choose(controller=path)
    assert session.task == "goal"
    with pytest.raises(ValueError, match="was trained for the task goal, not for the task velocity"):
        session.choose(task="velocity")
    session.choose(controller="lqr")
    assert session.task == "goal"
    session.choose(controller=str(SHIPPED))
    assert session.task == "balance"
    assert session.frame().commands is None


@pytest.mark.parametrize("controller", ["lqr", "cascade_pid", "pd_inverse_dynamics"])
def test_driving_is_followed_and_limited(controller):
    session = Session(task="velocity", controller=controller)
    before = command(session)
    session.drive(1.0, 1.0, -1.0)
    session.step()
    # The command gets there with limited acceleration.
    change, dt = command(session) - before, session.driver.control_dt
    assert np.linalg.norm(change[:2]) == pytest.approx(ACCELERATION * dt)
    assert abs(change[2]) == pytest.approx(YAW_ACCELERATION * dt)
    run(session, 3.0)
    np.testing.assert_allclose(command(session), [0.5 / math.sqrt(2), 0.5 / math.sqrt(2), -1.0], rtol=1e-12)
    assert session.frame().commands.by_hand
    session.drive(1.0, 0.0, 0.0)
    run(session, 10.0)
    assert not session.robots.fallen.any()
    state = session.robots.states[0]
    yaw = 2.0 * math.atan2(state.body_quaternion[3], state.body_quaternion[0])
    forward = [0.5 * math.cos(yaw), 0.5 * math.sin(yaw)]
    np.testing.assert_allclose(state.ball_velocity[:2], forward, atol=0.03)
    session.drive(0.0, 0.0, 0.0)
    run(session, 5.0)
    assert np.linalg.norm(session.robots.states[0].ball_velocity) < 0.02


@pytest.mark.slow("long drives")
@pytest.mark.parametrize("robot", Params.preset_names())
def test_no_keys_topple_lqr(robot):
    session = Session(robot=robot, task="velocity", num_robots=2)
    rng = np.random.default_rng(1)
    for _ in range(150):
        session.drive(*rng.integers(-1, 2, 3).astype(float))
        for _ in range(round(rng.choice([0.1, 0.3, 1.0]) / session.driver.control_dt)):
            session.step()
            assert not session.robots.fallen.any()
            # Half of the tilt that ends an episode.
            assert max(state.tilt for state in session.robots.states) < math.radians(15.0)


@pytest.mark.slow("many clicks")
@pytest.mark.parametrize("robot", Params.preset_names())
def test_no_click_topples_lqr_and_goals_are_near(robot):
    session = Session(robot=robot, task="goal")
    rng = np.random.default_rng(2)
    for _ in range(40):
        click = rng.uniform(-9.0, 9.0, 2)
        ball = session.robots.states[0].ball_position[:2]
        session.move_setpoint(*click)
        way = command(session) - ball
        assert np.linalg.norm(way) <= 2.0 + 1e-9
        np.testing.assert_allclose(way / np.linalg.norm(way), (click - ball) / np.linalg.norm(click - ball), atol=1e-9)
        run(session, rng.choice([0.2, 1.0, 3.0]))
        assert not session.robots.fallen.any()


def test_a_clicked_goal_is_reached_in_a_batch():
    session = Session(task="goal", num_robots=4)
    session.move_setpoint(1.2, -0.7)
    run(session, 15.0)
    for i, state in enumerate(session.robots.states):
        np.testing.assert_array_equal(command(session, i), [1.2, -0.7])
        np.testing.assert_allclose(state.ball_position[:2], [1.2, -0.7], atol=0.02)
    assert session.frame().commands.metrics["goals_held"] == 1.0


@pytest.mark.parametrize("change", [lambda s: s.change(motor_lag=5.0), lambda s: s.choose(controller="lqi")])
def test_a_change_while_a_command_turns_around_does_not_jump(change):
    session = Session(robot="rezero", task="velocity")
    session.drive(1.0, 0.0, 1.0)
    run(session, 5.0)
    session.drive(-1.0, 0.0, -1.0)
    session.step()
    before, dt = command(session), session.driver.control_dt
    change(session)
    np.testing.assert_array_equal(command(session), before)
    for _ in range(round(6.0 / dt)):
        session.step()
        assert np.linalg.norm((command(session) - before)[:2]) <= ACCELERATION * dt * (1.0 + 1e-9)
        before = command(session)
        assert session.robots.states[0].tilt < math.radians(15.0)
    limits = session.commanding
    np.testing.assert_array_equal(before, [-limits.max_speed, 0.0, -limits.max_yaw_rate])


def test_manual_goals_persist_through_a_fall_and_a_change():
    session = Session(task="goal", num_robots=2)
    session.move_setpoint(1.0, 0.0)
    session.commanding.restarted(session.robots, 0)
    before = [command(session, i) for i in range(2)]
    np.testing.assert_array_equal(before, [[0.0, 0.0], [1.0, 0.0]])
    session.change(motor_lag=5.0)
    np.testing.assert_array_equal([command(session, i) for i in range(2)], before)


def test_options_of_a_controller_match_the_task():
    law = dataclasses.replace(find("lqr"), env_options={"speed": 0.3, "control_dt": 0.01})
    session = Session(task="velocity", controller=law)
    assert session.commanding.max_speed == 0.3
    session.choose(task="goal")
    assert session.task == "goal"


def test_the_limits_match_the_options():
    session = Session(task="velocity", task_options={"speed": 0.2, "yaw_rate": 0.4})
    session.drive(-1.0, 0.0, 1.0)
    run(session, 2.0)
    np.testing.assert_allclose(command(session), [-0.2, 0.0, 0.4])
    # Another law has them, too; another task has its own.
    session.choose(controller="lqi")
    assert session.commanding.max_speed == 0.2
    session.choose(task="goal")
    assert session.commanding.max_distance == 2.0
    with pytest.raises(TypeError, match="speeed"):
        Session(task="velocity", task_options={"speeed": 0.2})


def test_manual_commands_persist_until_the_task_takes_over():
    session = Session(task="velocity")
    session.drive(0.5, 0.0, 0.0)
    run(session, 20.0)
    np.testing.assert_array_equal(command(session), [0.25, 0.0, 0.0])
    # Others that move on are commanded alike.
    for choice in ({"controller": "lqi"}, {"model": "spatial"}, {"observation": "sensors"}):
        session.choose(**choice)
        np.testing.assert_array_equal(command(session), [0.25, 0.0, 0.0])
    session.change(com_height=1.1)
    np.testing.assert_array_equal(command(session), [0.25, 0.0, 0.0])
    where = session.robots.states[0].to_array()
    session.sample_commands()
    np.testing.assert_array_equal(session.robots.states[0].to_array(), where)
    assert not np.array_equal(command(session), [0.25, 0.0, 0.0])
    assert not session.frame().commands.by_hand
    session.drive(0.5, 0.0, 0.0)
    session.reset()
    assert not session.frame().commands.by_hand


def test_repeating_a_command_does_not_restart_its_error():
    session, other = Session(task="velocity"), Session(task="velocity")
    for one in (session, other):
        one.drive(1.0, 0.0, 0.0)
    for _ in range(400):
        session.drive(1.0, 0.0, 0.0)
        session.step()
        other.step()
    assert session.frame().commands.metrics == other.frame().commands.metrics
    assert math.isfinite(session.frame().commands.metrics["velocity_error"])


@pytest.mark.parametrize("task", ["velocity", "goal"])
def test_after_a_fall_a_manually_commanded_robot_rests(task):
    session = Session(task=task)
    if task == "velocity":
        session.drive(1.0, 0.0, 0.0)
    else:
        session.move_setpoint(2.0, 0.0)
    session.push(0.0, 20.0)
    while not session.notices:
        session.step()
        assert session.time < LIES_FOR + 5.0
    assert session.notices[-1] == "robot 0 fell and starts again"
    run(session, 5.0)
    assert not command(session).any()
    assert np.linalg.norm(session.robots.states[0].ball_position[:2]) < 0.1


@pytest.mark.parametrize("seed", range(4))
def test_the_shown_curve_matches_the_moving_point(seed):
    pytest.importorskip("viser", reason="needs 'ballbot-rs[view]'")
    from ballbot_rs.media.arrows import path_of
    from ballbot_rs.viewer.scene.commands import SAMPLES

    session = Session(task="path", seed=seed)
    run(session, 2.0)
    # The center of the next curve is elsewhere.
    session.sample_commands()
    for _ in range(40):
        run(session, 0.25)
        commands = session.frame().commands
        curve = path_of(commands.values[0], commands.begins[0], SAMPLES)
        way = np.linalg.norm(np.diff(curve, axis=0), axis=1).max()
        assert np.linalg.norm(curve - commands.points[0], axis=1).min() < 0.55 * way
    np.testing.assert_allclose(
        session.robots.states[0].ball_position[:2], session.frame().commands.points[0], atol=0.15
    )


def test_a_push_of_the_task_is_shown():
    session = Session(task="push", task_options={"push": [0.3, 0.4]})
    assert np.isnan(session.frame().commands.pushes).all()
    run(session, 6.0)
    impulse, azimuth = session.frame().commands.pushes[0, :2]
    assert 0.0 < impulse < 2.0
    assert -math.pi <= azimuth <= 2.0 * math.pi


def test_a_replay_shows_the_commands():
    session = Session(task="goal")
    session.start_recording()
    run(session, 0.5)
    drawn = command(session)
    session.move_setpoint(1.0, 1.0)
    run(session, 0.5)
    session.replay()
    np.testing.assert_array_equal(command(session), drawn)
    assert not session.frame().commands.by_hand
    session.replay(0.9)
    np.testing.assert_array_equal(command(session), [1.0, 1.0])


@pytest.mark.parametrize(
    ("task", "misuse", "message"),
    [
        ("goal", lambda s: s.drive(1.0, 0.0, 0.0), "the task goal is not driven: choose the task velocity"),
        ("balance", lambda s: s.drive(1.0, 0.0, 0.0), "the task balance is not driven"),
        ("velocity", lambda s: s.drive(1.01, 0.0, 0.0), "forward = 1.01 is out of range: expected -1 to 1"),
        ("velocity", lambda s: s.drive(0.0, math.nan, 0.0), "left = nan is out of range"),
        ("velocity", lambda s: s.drive(0.0, 0.0, "1"), "turn = '1' is not a number"),
        ("velocity", lambda s: s.move_setpoint(1.0, 0.0), "a click is not a command of the task velocity"),
        ("goal", lambda s: s.move_setpoint(math.inf, 0.0), "x = inf is out of range"),
        ("push", lambda s: s.sample_commands(), "the task push has no commands"),
        ("balance", lambda s: s.sample_commands(), "the task balance has no commands"),
        ("goal", lambda s: s.choose(task="dance"), "unknown task 'dance'"),
    ],
)
def test_a_rejected_change_leaves_the_task_unchanged(task, misuse, message):
    session, other = Session(task=task), Session(task=task)
    with pytest.raises(ValueError, match=message):
        misuse(session)
    run(session, 0.3)
    run(other, 0.3)
    np.testing.assert_array_equal(session.frame().states, other.frame().states)
    assert session.task == task


def test_sensors_and_events_go_with_tasks():
    session = Session(task="velocity", observation="sensors", events="mild", num_robots=2, seed=3)
    run(session, 5.0)
    assert not session.robots.fallen.any()
    session.drive(0.4, 0.0, 0.0)
    session.sample_commands()
    run(session, 2.0)
    assert session.frame().estimated_tilt is not None
