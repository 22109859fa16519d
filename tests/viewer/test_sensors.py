"""Sensors of the robots of a session: what controllers see, and what changes it."""

import math

import numpy as np
import pytest

from ballbot_rs import BalanceEnv, Batch, Lqr, Params, State, load_sensors
from ballbot_rs.cli import main
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.viewer.panels.robot import table_of
from ballbot_rs.viewer.session.recording import SERIES
from ballbot_rs.viewer.session.robot import seed_of
from ballbot_rs.viewer.session.session import LIES_FOR, Session
from tests.viewer.test_viewer_session import MODELS, Linear, run

PAPER = Params.paper()

#: Worse than published sensors, with all errors that a factor changes.
NOISY = {"gyro_noise": 0.001, "gyro_bias": 0.02, "gyro_bias_walk": 0.001, "accelerometer_noise": 0.01}


class Seen:
    """LQR that keeps what it sees."""

    name = "seen"

    def __init__(self):
        self.states = []
        self._law = Lqr(control_dt=0.01)

    def __call__(self, state):
        self.states.append(state.to_array())
        return self._law(state)


def session_of(law, **arguments):
    controller = ResolvedController("seen", make_law=lambda *_: law)
    return Session(controller=controller, **{"sensors": "kugle", "observation": "sensors", **arguments})


@pytest.mark.parametrize("model", MODELS)
def test_controllers_see_the_estimates_of_the_environment(model):
    """The reference is a batch with the same sensors under the same torques, bit for bit."""
    law = Seen()
    session = session_of(law, model=model, sensors=NOISY, seed=5)
    options = {"sim_dt": 0.002, "control_dt": 0.01, "max_wheel_torque": PAPER.max_wheel_torque, "fall_tilt": math.pi}
    batch = Batch(1, model=model, sensors=NOISY, observation="sensors", seed=5, **options)
    batch.reset(starts=[State.at_rest(PAPER, session.start_tilt)])
    law.states.clear()
    for _ in range(50):
        expected = batch.estimates()[0]
        session.step()
        assert np.array_equal(law.states[-1], expected)
        batch.step(np.float32(session.frame().torques / PAPER.max_wheel_torque))
        assert np.array_equal(session.frame().states, batch.states())
    assert not np.array_equal(batch.estimates(), batch.states())


def test_a_policy_observes_the_same_as_in_the_environment():
    """The reference is the environment itself, with the same sensors, seed and start."""
    policy = Linear(control_dt=0.02, max_wheel_torque=0.5, sim_dt=0.001)
    session = Session(controller=policy.named("any.onnx"), sensors=NOISY, observation="sensors", seed=5)
    driver, robots, setpoint = session.driver, session.robots, (0.1, -0.2)
    options = {"sensors": NOISY, "observation": "sensors", "setpoint": setpoint, "fall_tilt": 1.0}
    env = BalanceEnv(**options, **policy.env_options)
    observation, _ = env.reset(seed=5, options={"state": robots.states[0]})
    for step in range(60):
        seen = driver.observe(0, robots.seen[0], setpoint)
        np.testing.assert_allclose(seen, observation, rtol=1e-5, atol=1e-6, err_msg=f"step {step}")
        observation, _, terminated, _, _ = env.step(policy.act(observation[np.newaxis])[0])
        robots.step(driver.torques(robots.seen, setpoint), round(driver.control_dt / driver.sim_dt))
        if terminated:
            break
    assert step > 10


def test_without_sensors_controllers_see_the_true_states():
    law = Seen()
    session = session_of(law, observation="ground_truth")
    plain = Session()
    law.states.clear()
    for _ in range(20):
        before = session.frame().states[0]
        session.step()
        plain.step()
        assert np.array_equal(law.states[-1], before)
        assert np.array_equal(session.frame().states, plain.frame().states)
    assert session.frame().estimated_tilt is None
    assert np.isnan(session.history.series()[SERIES["estimated tilt"]]).all()


@pytest.mark.parametrize("controller", ["lqr", "pid"])
def test_what_controllers_see_is_chosen_while_the_robot_moves(controller):
    session = Session(controller=controller)
    assert session.observation == "ground_truth"
    run(session, 0.1)
    before = session.frame().states
    session.choose(observation="sensors")
    assert session.observation == "sensors"
    np.testing.assert_allclose(session.frame().states, before, rtol=0.0, atol=1e-12)
    # An estimate begins at the true state.
    seen, state = session.robots.seen[0], session.robots.states[0]
    np.testing.assert_allclose(seen.body_quaternion, state.body_quaternion, atol=1e-12)
    np.testing.assert_allclose(seen.ball_position[:2], state.ball_position[:2], atol=1e-12)
    run(session, 0.5)
    assert not np.array_equal(session.robots.seen[0].to_array(), session.frame().states[0])
    # Published sensors where none were named.
    assert session.robots.setup.changed_sensors == load_sensors("kugle")
    session.choose(model="rigid")
    run(session, 0.1)
    session.choose(observation="ground_truth")
    assert session.robots.seen == session.robots.states
    with pytest.raises(ValueError, match="unknown observation 'truth': expected one of ground_truth, sensors"):
        session.choose(observation="truth")


def test_the_slider_is_a_factor_on_the_errors():
    session = Session(sensors={**NOISY, "latency": 0.02, "encoder_ticks": 4096.0}, observation="sensors")
    run(session, 0.1)
    before, params = session.frame().states, session.robots[0].params
    session.change(sensor_noise=2.0)
    assert session.robots.setup.changed_sensors == {
        **{name: 2.0 * value for name, value in NOISY.items()},
        "latency": 0.02,
        "encoder_ticks": 4096.0,
    }
    np.testing.assert_allclose(session.frame().states, before, rtol=0.0, atol=1e-12)
    assert session.robots[0].params == params
    assert "| gyro_bias | | 0.04 | |" in table_of(session)
    errors = {}
    for factor in (0.0, 1.0, 4.0):
        session.change(sensor_noise=factor)
        session.reset((0.0, 0.0))
        run(session, 2.0)
        series = session.history.series()
        errors[factor] = np.abs(series[SERIES["estimated tilt"]] - series[SERIES["tilt"]]).max()
    assert errors[0.0] < 0.3 * errors[1.0] < 0.3 * errors[4.0]


def test_the_estimator_uses_the_robot_without_changes():
    """What is estimated does not depend on whether the robot was changed before the sensors were chosen or after."""
    before, after = Session(), Session(sensors="kugle", observation="sensors")
    before.change(body_mass=1.5, wheel_friction=0.5)
    before.choose(observation="sensors")
    after.change(body_mass=1.5, wheel_friction=0.5)
    for session in (before, after):
        session.reset((0.02, 0.0))
        run(session, 0.5)
    assert before.robots[0].params == after.robots[0].params
    assert before.robots.seen == after.robots.seen
    assert np.array_equal(before.frame().states, after.frame().states)


@pytest.mark.slow("a long drive")
@pytest.mark.parametrize("model", MODELS)
def test_robots_on_estimates_fall_and_restart_for_a_long_time(model):
    session = Session(model, num_robots=4, events="hard", seed=3, sensors=NOISY, observation="sensors")
    rng = np.random.default_rng(0)
    for _ in range(12):
        session.push(rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 4.0))
        run(session, 1.0)
        assert np.isfinite(session.frame().states).all()
        assert np.isfinite([state.to_array() for state in session.robots.seen]).all()
    assert any("starts again" in notice for notice in session.notices)


@pytest.mark.parametrize("robot", ["paper", "kugle"])
def test_lqr_balances_on_estimates_after_a_push_and_a_reset(robot):
    session = Session(robot=robot, num_robots=3, sensors="kugle", observation="sensors")
    params = session.robots.setup.nominal
    impulse = 0.02 * (params.body_mass + params.ball_mass)

    def balances(seconds):
        run(session, seconds)
        for index, state in enumerate(session.robots.states):
            assert state.tilt < math.radians(1.5), f"robot {index}"
            assert np.linalg.norm(state.ball_position[:2]) < 0.1, f"robot {index}"
            assert session.robots.seen[index].tilt == pytest.approx(state.tilt, abs=math.radians(0.5))

    balances(10.0)
    session.push(0.7, impulse)
    session.step()
    assert np.linalg.norm(session.frame().states[0, 7:9]) > 1e-3
    balances(6.0)
    session.reset((0.0, 0.05))
    np.testing.assert_allclose(session.frame().estimated_tilt, [0.0, 0.05], atol=1e-3)
    balances(6.0)
    session.move_setpoint(0.3, 0.2)
    run(session, 6.0)
    np.testing.assert_allclose(session.frame().states[0, :2], [0.3, 0.2], atol=0.1)


def test_a_fallen_robot_restarts_with_a_new_estimate():
    session = Session(num_robots=2, sensors=NOISY, observation="sensors")
    session.robots[1].push([20.0, 0.0, 0.0])
    run(session, LIES_FOR + 3.0)
    assert session.notices[-1] == "robot 1 fell and starts again"
    for seen, state in zip(session.robots.seen, session.robots.states, strict=True):
        assert state.tilt < math.radians(5.0)
        assert seen.tilt == pytest.approx(state.tilt, abs=math.radians(2.0))


@pytest.mark.parametrize("observation", ["ground_truth", "sensors"])
@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ("kugel", "unknown sensors 'kugel'"),
        ({"gyro": 1.0}, "'gyro'"),
        ({"gyro_noise": -1.0}, "gyro_noise"),
        ({"latency": 0.003}, "latency"),
    ],
)
def test_invalid_sensors_are_rejected(sensors, message, observation):
    with pytest.raises(ValueError, match=message):
        Session(sensors=sensors, observation=observation)


def test_a_controller_whose_rate_does_not_fit_the_sensors_is_rejected_and_nothing_changes():
    session = Session(controller="pid", sensors={"latency": 0.002}, observation="sensors")
    run(session, 0.1)
    before = session.frame().states
    with pytest.raises(ValueError, match="latency"):
        session.choose(controller="lqr")
    assert session.controller == "pid"
    assert np.array_equal(session.frame().states, before)
    run(session, 0.1)


def test_the_command_line_has_sensors(capsys):
    given = ["view", "--no-open", "--set", "observation=sensors", "--seconds", "0.3", "--port", "18790"]
    assert main([*given, "--sensors", "kugle"]) == 0
    assert main([*given, "--sensors", "kugel"]) == 1
    assert "unknown sensors 'kugel'" in capsys.readouterr().err
    assert main(["view", "--no-open", "--set", "history=3"]) == 1
    assert "history" in capsys.readouterr().err


def test_sampled_motors_move_the_robots_of_the_page():
    """The reference is a batch with the same events, reset with the seeds of the episodes."""
    events = [
        {"term": "actuators.strength", "range": [0.5, 0.8]},
        {"term": "actuators.lag", "op": "abs", "range": [0.005, 0.02]},
    ]
    session = Session(num_robots=3, events=events, seed=7)
    batch = Batch(3, events=events, seed=7)
    strengths = set()
    for episode in range(3):
        if episode:
            session.reset()
        batch.reset(seeds=[seed_of(7 + robot, episode + 1) for robot in range(3)])
        for robot in range(3):
            motors = session.robots[robot].motors
            assert motors == {name: batch.actuators(robot)[name] for name in motors}
            assert set(motors) == {"strength", "lag"}
            strengths.add(tuple(motors["strength"]))
            np.testing.assert_array_equal(session.robots[robot].draws["actuators.lag"], [motors["lag"]])
        assert "actuators.lag" in table_of(session)
        run(session, 0.2)
    assert len(strengths) == 9
    ideal = Session(num_robots=3)
    ideal.reset()
    run(ideal, 0.2)
    assert not np.allclose(ideal.frame().states, session.frame().states, atol=1e-6)
