"""Changes of the robots of a session: parameters, events and motors."""

import math

import numpy as np
import pytest

from ballbot_rs import Batch, Params, State
from ballbot_rs._state_rows import tilt_components_of, tilt_of
from ballbot_rs.viewer.session.recording import SERIES
from ballbot_rs.viewer.session.robot import seed_of
from ballbot_rs.viewer.session.robots import FALLEN_TILT
from ballbot_rs.viewer.session.session import LIES_FOR, Session
from ballbot_rs.viewer.session.setup import CHANGES, NEUTRAL
from tests.viewer.test_viewer_session import MODELS, run

PAPER = Params.paper()

#: Value of each change, and the changed property of the paper's robot.
EXPECTED = {
    "wheel_friction": (0.4, {"wheel_static_friction": 0.44, "wheel_dynamic_friction": 0.4}),
    "floor_friction": (0.4, {"floor_static_friction": 0.44, "floor_dynamic_friction": 0.42}),
    "body_mass": (2.0, {"body_mass": 4.456, "body_inertia": (0.1166, 0.1166, 0.0274)}),
    "com_height": (1.5, {"body_com_height": 0.213}),
    "com_x": (5.0, {"body_com_offset": (0.005, 0.0)}),
    "com_y": (-5.0, {"body_com_offset": (0.0, -0.005)}),
    "motor_strength": (0.5, {"strength": [0.5, 0.5, 0.5]}),
    "motor_delay": (10.0, {"delay": 0.01}),
    "motor_lag": (7.0, {"lag": 0.007}),
    "sensor_noise": (2.0, {}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_has_its_stated_value_and_the_motion_continues(name):
    value, expected = EXPECTED[name]
    session = Session(num_robots=2)
    run(session, 0.1)
    before = session.frame().states
    session.change(**{name: value})
    np.testing.assert_allclose(session.frame().states, before, rtol=0.0, atol=1e-12)
    for robot in range(2):
        now = {**session.robots[robot].params.to_dict(), **session.robots[robot].motors}
        differs = {key for key in now if now[key] != PAPER.to_dict().get(key)}
        assert differs == set(expected)
        for key, number in expected.items():
            np.testing.assert_allclose(now[key], number, rtol=1e-12, err_msg=key)
    assert session.changes == {**NEUTRAL, name: value}
    # Controllers are designed for the nominal robot.
    assert session.robots.setup.nominal == PAPER
    run(session, 0.1)
    session.change(**NEUTRAL)
    assert session.robots[0].params == PAPER
    assert session.robots[0].motors == {}
    run(session, 4.0)
    assert math.hypot(*session.frame().tilt) < math.radians(0.2)


def test_inertia_and_friction_change_in_proportion():
    products = (0.001, -0.002, 0.003)
    params = PAPER.replace(body_products_of_inertia=products, wheel_static_friction=2.0)
    session = Session(robot="mine", params=params)
    session.change(body_mass=0.5, wheel_friction=0.1)
    now = session.robots[0].params
    np.testing.assert_allclose(now.body_products_of_inertia, 0.5 * np.array(products))
    assert (now.wheel_static_friction, now.wheel_dynamic_friction) == pytest.approx((0.2, 0.1))


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308, -1e308, 1e9, True, "1", None, [1.0]])
def test_invalid_values_of_a_change_change_nothing(name, value):
    session = Session()
    run(session, 0.05)
    before = session.frame().states
    with pytest.raises(ValueError, match=f"{name} = "):
        session.change(**{"body_mass": 1.1, "com_height": 1.1, name: value})
    assert session.changes == dict(NEUTRAL)
    assert session.robots[0].params == PAPER
    assert np.array_equal(session.frame().states, before)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"com_x": 100.0, "com_height": 0.5}, "the load of wheel 1 in equilibrium"),
        ({"motor_delay": 5.0}, r"actuators\.delay / sim_dt = 2\.5 is out of range"),
        ({"mass": 1.0}, "unknown change 'mass'"),
    ],
)
def test_an_invalid_robot_is_rejected_and_nothing_changes(values, message):
    session, other = Session(num_robots=3), Session(num_robots=3)
    run(session, 0.1)
    run(other, 0.1)
    with pytest.raises(ValueError, match=message):
        session.change(**values)
    assert session.changes == dict(NEUTRAL)
    run(session, 0.2)
    run(other, 0.2)
    assert np.array_equal(session.frame().states, other.frame().states)


def test_a_change_that_one_sampled_robot_rejects_changes_none():
    """Half of the robots are sampled at a mass whose tenth is less than the mass of the wheels."""
    events = [{"term": "body_mass", "op": "scale", "mode": "startup", "range": [0.2, 1.5]}]
    session = Session(num_robots=6, events=events)
    before = [session.robots[i].params for i in range(6)]
    states = session.frame().states
    with pytest.raises(ValueError, match="body_mass"):
        session.change(body_mass=0.1)
    assert [session.robots[i].params for i in range(6)] == before
    assert session.changes == dict(NEUTRAL)
    assert np.array_equal(session.frame().states, states)


def test_planar_rejects_a_center_of_mass_off_the_mast():
    session = Session("planar")
    with pytest.raises(ValueError, match="symmetric about their mast"):
        session.change(com_x=5.0)
    session.choose(model="contact")
    session.change(com_x=5.0)
    with pytest.raises(ValueError, match="symmetric about their mast"):
        session.choose(model="planar")
    assert session.robots.model == "contact"
    assert session.changes["com_x"] == 5.0
    # Another robot, another model and another controller have the changes, too.
    for choice in ({"robot": "kugle"}, {"model": "rigid"}, {"controller": "pid"}, {"num_robots": 4}):
        session.choose(**choice)
        assert session.robots[0].params.body_com_offset == (0.005, 0.0)
        run(session, 0.05)


@pytest.mark.parametrize("model", MODELS)
def test_motors_match_the_environment(model):
    """The reference is a batch with the same motors under the same commands, bit for bit."""
    motors = {"delay": 0.006, "lag": 0.01, "strength": [0.8, 0.9, 1.1]}
    session = Session(model, motors=motors)
    batch = Batch(1, model=model, control_dt=0.002, max_wheel_torque=PAPER.max_wheel_torque, actuators=motors)
    batch.reset(starts=[State.at_rest(PAPER, session.start_tilt)])
    for _ in range(30):
        session.step()
        action = np.float32(session.frame().torques / PAPER.max_wheel_torque)
        for _ in range(5):
            batch.step(action)
    assert np.array_equal(session.frame().states, batch.states())


def test_motors_without_strength_move_nothing_and_delay_begins_with_none():
    free, weak, late = Session(controller="zero"), Session(), Session()
    weak.change(motor_strength=0.0)
    late.change(motor_delay=100.0)
    for session in (free, weak, late):
        run(session, 0.1)
    np.testing.assert_allclose(weak.frame().states, free.frame().states, atol=1e-12)
    np.testing.assert_allclose(late.frame().states, free.frame().states, atol=1e-12)
    run(free, 0.05)
    run(late, 0.05)
    assert np.abs(late.frame().states - free.frame().states).max() > 1e-3


@pytest.mark.parametrize("offset", [(20.0, 0.0), (-10.0, 15.0)])
def test_the_tilt_is_relative_to_the_equilibrium(offset):
    """A robot at rest in equilibrium leans by the angle whose tangent is offset by height, and its tilt is zero."""
    session = Session(controller="zero")
    session.change(com_x=offset[0], com_y=offset[1])
    session.reset((0.0, 0.0))
    lean = math.atan2(math.hypot(*offset), 1e3 * PAPER.body_com_height)
    assert session.robots.states[0].tilt == pytest.approx(lean, abs=1e-12)
    run(session, 0.2)
    assert math.hypot(*session.frame().tilt) < 1e-9
    assert np.abs(session.history.series()[SERIES["tilt"]]).max() < 1e-9
    session.reset((0.02, -0.03))
    np.testing.assert_allclose(session.frame().tilt, [0.02, -0.03], atol=1e-12)


def test_a_robot_has_fallen_by_its_tilt_from_the_equilibrium():
    session = Session("spatial", controller="zero")
    session.change(com_x=30.0)
    session.reset((0.0, 0.05))
    com = np.array([0.03, 0.0, PAPER.body_com_height])
    while not session.robots.fallen[0]:
        before = session.frame().states[0]
        session.step()
        assert session.time < 5.0
    after = session.robots.states[0]
    assert tilt_of(before, com) < FALLEN_TILT < tilt_of(after.to_array(), com)
    assert abs(after.tilt - FALLEN_TILT) > 0.1


def test_tilt_components_match_states_for_a_center_of_mass_on_the_mast():
    rng = np.random.default_rng(0)
    states = [State.at_rest(PAPER, rng.uniform(-1.0, 1.0, 2), yaw) for yaw in rng.uniform(-3.0, 3.0, 50)]
    states.append(State.at_rest(PAPER))
    for com in ((0.0, 0.0, 0.142), (0.0, 0.0, 3.0)):
        found = tilt_components_of(np.array([state.to_array() for state in states]), com)
        np.testing.assert_allclose(found, [state.tilt_components for state in states], atol=1e-14)
    # For a center of mass off the mast they equal the input of the state.
    params = PAPER.replace(body_com_offset=(0.02, -0.01))
    for tilt, yaw in (((0.1, -0.2), 2.0), ((0.0, 0.0), -1.0), ((-0.4, 0.3), 0.0)):
        state = State.at_equilibrium(params, tilt, yaw).to_array()
        np.testing.assert_allclose(tilt_components_of(state, params.body_com), tilt, atol=1e-12)


EVENTS = [
    {"term": "body_mass", "op": "scale", "range": [0.8, 1.2]},
    {"term": "body_com_offset", "range": [-0.004, 0.004]},
    {"term": "wheel_dynamic_friction", "mode": "startup", "range": [0.7, 1.0]},
]


def test_each_reset_samples_the_robot_of_the_environment():
    """The reference is the batch of as many environments, reset with the seeds of the episodes."""
    session = Session(num_robots=3, events=EVENTS, seed=7)
    batch = Batch(3, events=EVENTS, seed=7)
    seen = []
    for episode in range(4):
        if episode:
            session.reset()
        batch.reset(seeds=[seed_of(7 + robot, episode + 1) for robot in range(3)])
        for robot in range(3):
            params = session.robots[robot].params
            assert params == batch.params(robot)
            seen.append(params.body_mass)
            draws = session.robots[robot].draws
            assert draws["body_mass"] == pytest.approx(params.body_mass / PAPER.body_mass)
        np.testing.assert_allclose(np.hypot(*session.frame().tilt), math.radians(3.0), atol=1e-12)
    assert len(set(seen)) == 12
    # Changes of other environments keep the episode and its random numbers.
    for action in (
        lambda: session.change(motor_delay=10.0),
        lambda: session.change(com_x=3.0),
        lambda: session.choose(model="rigid"),
        lambda: session.choose(controller="pid"),
    ):
        action()
        for robot in range(3):
            assert session.robots[robot].params.body_mass == batch.params(robot).body_mass
    session.reset()
    batch.reset(seeds=[None, None, seed_of(9, 5)])
    assert session.robots[2].params.body_mass == batch.params(2).body_mass


def test_a_fallen_robot_is_resampled_and_the_others_remain():
    session = Session(num_robots=3, events=EVENTS)
    before = [session.robots[i].params for i in range(3)]
    session.robots[1].push([20.0, 0.0, 0.0])
    run(session, LIES_FOR + 3.0)
    assert session.notices[-1] == "robot 1 fell and starts again"
    after = [session.robots[i].params for i in range(3)]
    assert [a == b for a, b in zip(after, before, strict=True)] == [True, False, True]


def test_pushes_and_intervals_of_events_act():
    events = [
        {"term": "push", "mode": "at", "at": 0.5, "range": [0.3, 0.3], "direction": 0.0},
        {"term": "wheel_dynamic_friction", "mode": "interval", "every": [0.2, 0.2], "range": [0.5, 0.9]},
    ]
    session = Session(events=events)
    session.reset((0.0, 0.0))
    run(session, 0.49)
    assert np.abs(session.frame().states[0, 7:9]).max() < 1e-6
    friction = {session.robots[0].params.wheel_dynamic_friction}
    run(session, 0.5)
    assert session.frame().states[0, 7] > 0.01
    friction.add(session.robots[0].params.wheel_dynamic_friction)
    assert len(friction) == 2
    np.testing.assert_allclose(session.robots[0].draws["push"][:1], [0.3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"events": "soft"}, "unknown set of events 'soft'"),
        ({"events": [{"term": "body_mass", "range": [0.0, 1.0]}]}, r"events\[0\] \(body_mass\)"),
        ({"motors": "nobody"}, "unknown actuators 'nobody'"),
        ({"motors": {"delay": -1.0}}, r"actuators\.delay"),
    ],
)
def test_invalid_events_and_motors_are_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        Session(**arguments)


@pytest.mark.slow("a long drive")
@pytest.mark.parametrize("model", MODELS)
def test_hard_randomized_robots_fall_and_restart_for_a_long_time(model):
    session = Session(model, controller="lqr", num_robots=4, events="hard", seed=3)
    rng = np.random.default_rng(0)
    for _ in range(12):
        session.push(rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 4.0))
        run(session, 1.0)
        assert np.isfinite(session.frame().states).all()
    assert any("starts again" in notice for notice in session.notices)


def test_a_robot_that_does_not_allow_the_tilt_restarts_in_equilibrium():
    session = Session(num_robots=2)
    session.change(com_x=10.0)
    run(session, 0.1)
    robot = session.robots[0]
    before = robot.state
    with pytest.raises(ValueError, match="floor"):
        robot.start((1.5, 0.0))
    assert robot.state == before
    robot.restart((1.5, 0.0))
    assert np.abs(session.frame().tilt).max() < 1e-12
