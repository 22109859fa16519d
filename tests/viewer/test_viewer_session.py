"""The session behind `ballbot view`, without a browser."""

import dataclasses
import math
import threading
import time

import numpy as np
import pytest

from ballbot_rs import BalanceEnv, Ballbot, Lqr, Params, State
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.session.drivers import LawDriver, PolicyDriver
from ballbot_rs.viewer.session.recording import CAPACITY, SERIES, SPAN, Recording
from ballbot_rs.viewer.session.runner import MAX_COMMANDS, Runner
from tests.support.waiting import wait_until

MODELS = ["planar", "spatial", "contact", "rigid"]


class Linear:
    """A policy that is linear in the observation, or what `choose` returns."""

    def __init__(self, choose=None, **env_options):
        self.env_options = env_options
        self._gain = np.random.default_rng(0).normal(scale=0.5, size=(3, 16)).astype(np.float32)
        self._choose = choose or (lambda observation: self._gain @ observation)

    def act(self, observations):
        assert observations.shape == (1, 16)
        assert observations.dtype == np.float32
        return np.asarray(self._choose(observations[0]))[np.newaxis]

    def named(self, name):
        return ResolvedController(name, self.env_options, self.act)


def run(session, seconds):
    for _ in range(round(seconds / session.driver.control_dt)):
        session.step()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("robot", Params.preset_names())
def test_lqr_balances_every_robot_on_every_model_after_a_push(model, robot):
    session = Session(model, robot)
    params = Params.preset(robot)
    session.push(0.7, 0.03 * (params.body_mass + params.ball_mass))
    session.step()
    velocity = session.frame().states[0, 7:9]
    assert np.linalg.norm(velocity) > 1e-3
    run(session, 6.0)
    frame = session.frame()
    # The dry friction of asroballet's wheels keeps it swinging a little.
    assert math.hypot(*frame.tilt) < math.radians(1.5 if robot == "asroballet" else 0.1)
    assert frame.time == pytest.approx(6.01)
    assert frame.robot == robot


@pytest.mark.parametrize("model", MODELS)
def test_a_push_is_an_impulse_in_the_inertial_frame(model):
    session = Session(model, controller="zero")
    robot = Ballbot(None, model, session.driver.sim_dt)
    robot.reset(State.at_rest(robot.params, session.start_tilt))
    robot.push([-0.1, 0.1 * math.sqrt(3.0), 0.0])
    robot.step([0.0, 0.0, 0.0], 5)
    session.push(math.radians(120.0), 0.2)
    session.step()
    np.testing.assert_allclose(session.frame().states[0], robot.state.to_array(), atol=1e-12)


@pytest.mark.parametrize("first", MODELS)
@pytest.mark.parametrize("second", MODELS)
def test_the_motion_continues_when_the_model_is_switched(first, second):
    session = Session(first)
    session.push(0.0, 0.2)
    run(session, 0.1)
    before = session.frame()
    session.choose(model=second)
    after = session.frame()
    assert session.robots.model == second
    np.testing.assert_allclose(after.tilt, before.tilt, atol=1e-12)
    np.testing.assert_allclose(after.states[:, :10], before.states[:, :10], atol=2e-3)
    run(session, 4.0)
    assert math.hypot(*session.frame().tilt) < math.radians(0.5)


def test_controllers_are_switched_while_the_robot_moves():
    session = Session(controller="pid")
    assert session.driver.control_dt == 0.002
    run(session, 1.0)
    for name, control_dt in (("lqr", 0.01), ("zero", 0.01), ("pid", 0.002), ("lqr", 0.01)):
        state = session.frame().states
        session.choose(controller=name)
        assert np.array_equal(session.frame().states, state)
        assert session.driver.control_dt == control_dt
        run(session, 0.05)
    run(session, 5.0)
    assert math.hypot(*session.frame().tilt) < math.radians(0.1)


def test_the_setpoint_is_reached():
    session = Session()
    session.move_setpoint(0.5, -0.3)
    run(session, 8.0)
    np.testing.assert_allclose(session.frame().states[0, :2], [0.5, -0.3], atol=0.01)


def test_pulling_moves_the_robot_and_releasing_lets_it_return():
    session = Session()
    session.reset((0.0, 0.0))
    session.pull([0.3, 0.0, 0.25])
    run(session, 1.0)
    assert session.frame().states[0, 0] > 0.02
    session.pull(None)
    run(session, 8.0)
    assert np.linalg.norm(session.frame().states[0, :2]) < 0.01


@pytest.mark.parametrize("model", MODELS)
def test_a_policy_observes_and_acts_as_in_the_environment(model):
    """The reference is the environment itself, with the same setpoint and start: observations are bit-identical."""
    policy = Linear(control_dt=0.02, max_wheel_torque=0.5, sim_dt=0.001)
    session = Session(model)
    session.choose(controller=policy.named("any.onnx"))
    session.reset((0.02, -0.01))
    driver, robots, setpoint = session.driver, session.robots, (0.1, -0.2)
    env = BalanceEnv(model=model, setpoint=setpoint, fall_tilt=1.0, **policy.env_options)
    observation, _ = env.reset(options={"state": robots.states[0]})
    for step in range(60):
        seen = driver.observe(0, robots.states[0], setpoint)
        np.testing.assert_allclose(seen, observation, rtol=1e-5, atol=1e-6, err_msg=f"step {step}")
        observation, _, terminated, _, _ = env.step(policy.act(observation[np.newaxis])[0])
        robots.step(driver.torques(robots.states, setpoint), round(driver.control_dt / driver.sim_dt))
        np.testing.assert_allclose(session.frame().states[0], env.state.to_array(), rtol=1e-7, atol=1e-7)
        if terminated:
            break
    assert step > 10


def fail(_):
    raise KeyError("no such input")


@pytest.mark.parametrize(
    ("choose", "message"),
    [
        (lambda _: np.full(3, np.nan), "expected three finite numbers"),
        (lambda _: np.zeros(2), "expected three finite numbers"),
        (fail, "no such input"),
    ],
)
def test_a_policy_with_invalid_actions_turns_the_motors_off(choose, message):
    session = Session()
    session.choose(controller=Linear(choose).named("bad.onnx"))
    runner = Runner(session)
    runner.start()
    wait_until(lambda: session.controller == "zero")
    runner.stop()
    assert runner.error is None
    assert message in session.notices[-1]
    assert session.notices[-1].endswith("; the motors are off")


def test_a_policy_continues_when_the_model_is_switched_and_ends_with_another_controller():
    session = Session()
    session.choose(controller=Linear().named("a.onnx"))
    session.choose(model="rigid")
    assert isinstance(session.driver, PolicyDriver)
    assert session.controller == "a.onnx"
    session.choose(controller="lqr")
    assert isinstance(session.driver, LawDriver)


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("policy.zip", b"PK", ValueError, "policy file that ends in .onnx"),
        ("policy.pkl", b"cos\nsystem\n", ValueError, "policy file that ends in .onnx"),
        ("missing.onnx", None, FileNotFoundError, "no policy at"),
        ("lqrr", None, ValueError, "unknown controller"),
    ],
)
def test_only_onnx_files_are_read(tmp_path, name, content, error, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    session = Session()
    with pytest.raises(error, match=message):
        session.choose(controller=str(path))
    assert session.controller == "lqr"
    run(session, 0.1)


@pytest.mark.parametrize(
    "misuse",
    [
        lambda s: s.push(0.0, math.nan),
        lambda s: s.push(math.inf, 0.1),
        lambda s: s.push(0.0, 1e9),
        lambda s: s.push("north", 0.1),
        lambda s: s.push(0.0, True),
        lambda s: s.move_setpoint(math.nan, 0.0),
        lambda s: s.move_setpoint(1e3, 0.0),
        lambda s: s.reset((1.5, 0.0)),
        lambda s: s.reset((math.nan, 0.0)),
        lambda s: s.reset((0.1, 0.0, 0.0)),
        lambda s: s.set_speed(0.0),
        lambda s: s.set_speed(None),
        lambda s: s.pull([0.0, math.inf, 0.0]),
        lambda s: s.pull([0.0, 0.0]),
        lambda s: s.choose(model="flat"),
        lambda s: s.choose(robot="../kugle"),
        lambda s: s.choose(controller=""),
        lambda s: s.choose(num_robots=0),
        lambda s: s.choose(num_robots=10**6),
        lambda s: s.choose(num_robots="4"),
        lambda s: s.replay(),
    ],
)
def test_a_rejected_change_leaves_the_session_unchanged(misuse):
    session, other = Session(), Session()
    with pytest.raises((ValueError, FileNotFoundError)):
        misuse(session)
    run(session, 0.2)
    run(other, 0.2)
    assert np.array_equal(session.frame().states, other.frame().states)
    assert session.replay_time is None


@pytest.mark.parametrize("control_dt", [0.0, -1.0, math.nan, math.inf, 1e-9, 2.0])
def test_a_law_with_a_time_step_out_of_range_is_rejected(control_dt):
    law = ResolvedController("mine", make_law=lambda *_: Lqr(), control_dt=control_dt)
    with pytest.raises(ValueError, match=f"mine has control_dt = {control_dt}, which is out of range"):
        Session(controller=law)


def test_a_policy_with_too_many_time_steps_is_rejected():
    session = Session()
    with pytest.raises(ValueError, match=r"fine.onnx has 10000 time steps of sim_dt = 1e-06.*expected at most 1000"):
        session.choose(controller=Linear(sim_dt=1e-6, control_dt=0.01).named("fine.onnx"))
    assert session.controller == "lqr"


@pytest.mark.parametrize("control_dt", [0.001, 0.003, 0.005, 0.0125])
def test_a_controller_runs_at_its_rate(control_dt):
    session = Session(
        controller=ResolvedController("mine", make_law=lambda *_: Lqr(control_dt=control_dt), control_dt=control_dt)
    )
    assert session.driver.sim_dt <= 0.002 + 1e-12
    run(session, 3.0)
    # As much time has passed for the robot, whose torques differ only by the rounding of the law's torques to float32.
    robot, law = Ballbot(None, "contact", session.driver.sim_dt), Lqr(control_dt=control_dt)
    robot.reset(State.at_rest(robot.params, session.start_tilt))
    while robot.time < session.time - 0.5 * control_dt:
        robot.step(law(robot.state), round(control_dt / session.driver.sim_dt))
    assert robot.time == pytest.approx(session.time, abs=1e-9)
    np.testing.assert_allclose(session.frame().states[0], robot.state.to_array(), atol=1e-6)
    assert math.hypot(*session.frame().tilt) < math.radians(0.2)


def test_robots_of_a_batch_start_in_all_directions():
    session = Session(num_robots=4)
    tilts = np.array([state.tilt_components for state in session.robots.states])
    np.testing.assert_allclose(tilts.sum(axis=0), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(tilts, axis=1), math.radians(3.0))
    # Each of them equals a single robot.
    alone = Session()
    alone.reset(tilts[1])
    run(session, 0.5)
    run(alone, 0.5)
    np.testing.assert_allclose(session.frame().states[1], alone.frame().states[0], atol=1e-6)


def test_a_robot_that_falls_forever_restarts():
    session = Session("spatial", controller="zero", num_robots=2)
    for _ in range(200):
        session.push(0.0, 20.0)
        run(session, 0.5)
        if session.notices:
            break
    assert "the range of the simulation" in session.notices[-1]
    assert np.isfinite(session.frame().states).all()


def test_a_replay_shows_what_was_and_stays_open_at_its_end():
    session = Session()
    session.start_recording()
    live = []
    for _ in range(50):
        session.step()
        live.append(session.frame())
    session.replay()
    assert not session.is_recording
    assert np.array_equal(session.frame().states, live[0].states)
    session.advance(0.2)
    assert np.array_equal(session.frame().states, live[20].states)
    assert session.frame().tilt == pytest.approx(live[20].tilt)
    session.advance(100.0)
    assert np.array_equal(session.frame().states, live[-1].states)
    session.advance(100.0)
    assert session.replay_time == pytest.approx(session.recording.duration)
    session.replay(0.1)
    assert np.array_equal(session.frame().states, live[10].states)
    # The robots waited.
    session.end_replay()
    assert np.array_equal(session.frame().states, live[-1].states)
    session.step()
    assert session.frame().time > live[-1].time


def test_a_frame_does_not_change_after_it_was_taken():
    session = Session()
    session.reset(tilt=(0.05, 0.0))
    session.advance(0.1)
    frame = session.frame()
    torques = frame.torques.copy()
    session.reset(tilt=(0.0, 0.0))
    assert np.any(torques != 0.0)
    np.testing.assert_array_equal(frame.torques, torques)


def test_a_recording_is_bounded():
    recording = Recording()
    frame = Session(num_robots=64).frame()
    for i in range(CAPACITY // 64):
        assert recording.add(dataclasses.replace(frame, time=0.01 * i))
    assert not recording.add(dataclasses.replace(frame, time=1e3))
    assert len(recording.frames) * 64 <= CAPACITY


def test_history_has_the_last_seconds_of_the_results_of_the_models():
    session = Session()
    session.push(0.5, 0.3)
    run(session, SPAN + 3.0)
    series = session.history.series()
    time_ = series[SERIES["time"]][0]
    assert time_[-1] - time_[0] == pytest.approx(SPAN, abs=0.05)
    assert np.all(np.diff(time_) > 0.0)
    params = session.robots.setup.nominal
    height = sum(math.cos(params.wheel_zenith) * load for load in series[SERIES["loads"]][:, -1])
    assert height == pytest.approx(params.body_mass * params.gravity, rel=1e-3)
    assert series[SERIES["utilization"]][:, -1].max() < 0.01


def test_slow_motion_pause_and_single_steps():
    session = Session()
    session.set_speed(0.25)
    assert session.advance(1.0) == pytest.approx(0.25)
    # What does not fill a control step is kept.
    assert sum(session.advance(0.001) for _ in range(400)) == pytest.approx(0.1)
    session.paused = True
    assert session.advance(1.0) == 0.0
    before = session.time
    session.step()
    assert session.time == pytest.approx(before + 0.01)


def test_the_runner_keeps_real_time_and_obeys_from_many_threads():
    shown = []
    session = Session()
    runner = Runner(session, lambda _, frame: shown.append((threading.current_thread().name, frame.time)))
    runner.start()
    done = []

    def flood():
        for i in range(50):
            runner.submit(lambda s, i=i: (s.push(0.1 * i, 0.001), done.append(threading.current_thread().name)))
            time.sleep(0.002)

    threads = [threading.Thread(target=flood) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_until(lambda: len(done) == 200)
    time.sleep(0.3)
    runner.stop()
    assert {name for name, _ in shown} == set(done) == {"ballbot-simulation"}
    assert 0.8 < runner.simulated / runner.elapsed < 1.2
    assert "real-time factor" in runner.report()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_race_within_viser_ends_no_simulation_but_other_errors_do():
    errors = [RuntimeError("deque mutated during iteration"), None, RuntimeError("the page is broken")]

    def show(*_):
        error = errors.pop(0) if errors else None
        if error is not None:
            raise error

    runner = Runner(Session(), show)
    runner.start()
    wait_until(lambda: runner.error is not None)
    assert errors == []
    assert str(runner.error) == "the page is broken"
    runner.stop()


def test_a_command_that_fails_and_a_flood_of_commands_do_no_harm():
    session = Session()
    runner = Runner(session)
    accepted = [runner.submit(lambda s: s.push(0.0, math.nan)) for _ in range(10 * MAX_COMMANDS)]
    assert accepted.count(True) == MAX_COMMANDS
    runner.start()
    wait_until(lambda: session.notices and session.time > 0.1)
    assert runner.submit(lambda s: s.choose(robot=["kugle"]))
    assert runner.submit(lambda s: s.choose(robot="kugle"))
    wait_until(lambda: session.robots.name == "kugle")
    runner.stop()
    assert "impulse = nan" in session.notices[0]


def test_custom_parameters_are_a_robot_in_addition_to_the_presets():
    params = Params.paper().replace(body_mass=3.0)
    session = Session(robot="mine", params=params)
    assert session.robots.setup.nominal == params
    assert session.robot_names == ["mine", *Params.preset_names()]
    session.choose(robot="paper")
    session.choose(robot="mine")
    assert session.robots.setup.nominal == params
    torques = Lqr(params, 0.01)(session.robots.states[0])
    assert np.array_equal(session.driver.torques(session.robots.states, (0.0, 0.0))[0], torques)
