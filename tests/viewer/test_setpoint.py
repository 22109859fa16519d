"""Nothing that a user clicks on the floor topples a balancing robot."""

import math

import numpy as np
import pytest

from ballbot_rs import Params
from ballbot_rs._state_rows import BALL_POSITION
from ballbot_rs.viewer.panels.status import _goal_of
from ballbot_rs.viewer.session.balancing import RADIUS
from ballbot_rs.viewer.session.robots import FALLEN_TILT
from ballbot_rs.viewer.session.session import LIES_FOR, Session
from tests.support.paths import ASSETS
from tests.viewer.test_viewer_session import Linear, run

POLICY = str(ASSETS / "policies" / "balance.onnx")


def click_about(session, clicks, *, reach=5.0, seed=0):
    """Random goals, some of them before the last one is reached; the largest tilt, rad."""
    rng = np.random.default_rng(seed)
    worst = 0.0
    for _ in range(clicks):
        session.move_setpoint(*rng.uniform(-reach, reach, 2))
        for _ in range(round(rng.choice([0.2, 1.0, 2.0, 5.0]) / session.driver.control_dt)):
            session.step()
            worst = max(worst, *(state.tilt for state in session.robots.states))
            assert not session.robots.fallen.any(), f"fell at {session.time:.2f} s on the way to {session.setpoint}"
    return worst


@pytest.mark.slow("a hundred clicks")
@pytest.mark.parametrize("robot", Params.preset_names())
def test_a_hundred_clicks_do_not_topple_lqr(robot):
    assert click_about(Session("contact", robot, "lqr"), 100) < math.radians(8.0)


@pytest.mark.slow("a hundred clicks")
def test_a_hundred_clicks_do_not_topple_the_shipped_policy():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    assert click_about(Session("contact", "paper", POLICY), 100) < math.radians(8.0)


@pytest.mark.slow("a hundred clicks")
@pytest.mark.parametrize("controller", ["lqr", POLICY])
@pytest.mark.parametrize("model", ["planar", "spatial", "rigid"])
def test_clicks_do_not_topple_on_other_models(model, controller):
    if controller == POLICY:
        pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    assert click_about(Session(model, "paper", controller), 15) < math.radians(8.0)


@pytest.mark.parametrize("goal", [(5.0, 0.0), (0.0, -5.0), (-5.0, 5.0)])
def test_a_far_goal_is_reached(goal):
    session = Session()
    session.move_setpoint(*goal)
    run(session, 60.0)
    np.testing.assert_allclose(session.frame().states[0, :2], goal, atol=0.01)
    np.testing.assert_allclose(session.frame().target, goal, atol=1e-9)


@pytest.mark.slow("a long drive")
def test_controllers_are_switched_and_the_robot_pushed_on_the_way():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    session = Session()
    rng = np.random.default_rng(3)
    for i in range(40):
        session.choose(controller=("lqr", POLICY)[i % 2])
        session.move_setpoint(*rng.uniform(-5.0, 5.0, 2))
        # What the page's button does before its sliders are moved.
        session.push(rng.uniform(0.0, 2.0 * math.pi), 0.3)
        run(session, 2.0)
        assert not session.robots.fallen.any()


def test_pid_does_not_pretend_to_follow_a_goal():
    session = Session(controller="pid")
    with pytest.raises(ValueError, match="pid does not follow a setpoint"):
        session.move_setpoint(1.0, 0.0)
    assert session.frame().setpoint is None
    assert session.frame().target is None
    session.choose(controller="lqr")
    assert np.array_equal(session.frame().setpoint, [0.0, 0.0])


@pytest.mark.parametrize("robot", [name for name in Params.preset_names() if name != "paper"])
def test_a_policy_is_rejected_on_a_robot_that_it_does_not_balance(robot):
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    session = Session(controller=POLICY)
    with pytest.raises(ValueError, match=f"trained on another robot and does not balance {robot}: in a trial it fell"):
        session.choose(robot=robot)
    assert (session.robots.name, session.controller) == ("paper", POLICY)
    with pytest.raises(ValueError, match="does not balance"):
        Session(robot=robot, controller=POLICY)


def test_a_policy_is_accepted_on_robots_that_it_balances_and_on_its_training_robot():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    heavier = Params.paper().replace(body_mass=1.05 * Params.paper().body_mass)
    session = Session(robot="heavier", params=heavier, controller=POLICY)
    run(session, 10.0)
    assert not session.robots.fallen.any()
    # One that falls on the robot of its training may be looked at.
    session = Session()
    session.choose(controller=Linear(lambda _: np.zeros(3)).named("lazy.onnx"))
    assert session.controller == "lazy.onnx"


def test_after_a_fall_robot_and_setpoint_restart():
    session = Session("contact")
    session.move_setpoint(2.0, 0.0)
    run(session, 1.0)
    session.push(0.0, 20.0)
    fell = None
    for _ in range(1000):
        session.step()
        if fell is None and session.robots.fallen[0]:
            fell = session.time
        if fell is not None and session.time > fell + 0.1 and session.robots.fallen[0]:
            assert np.array_equal(session.frame().torques[0], np.zeros(3))
        if session.notices:
            break
    assert list(session.notices) == ["robot 0 fell and starts again"]
    assert session.time == pytest.approx(fell + LIES_FOR, abs=0.05)
    assert np.array_equal(session.setpoint, [0.0, 0.0])
    run(session, 5.0)
    assert np.linalg.norm(session.frame().states[0, :2]) < 0.05
    assert session.robots.states[0].tilt < math.radians(0.5)


def test_a_robot_without_motors_stays_where_it_fell():
    session = Session("contact", controller="zero")
    run(session, 10.0)
    assert session.robots.states[0].tilt > FALLEN_TILT
    assert not session.notices


def test_a_reset_restores_the_setpoint():
    session = Session()
    session.move_setpoint(3.0, 1.0)
    run(session, 2.0)
    session.reset()
    assert np.array_equal(session.setpoint, [0.0, 0.0])
    run(session, 5.0)
    assert np.linalg.norm(session.frame().states[0, :2]) < 0.01


def test_one_robot_of_a_batch_restarts_and_the_others_continue():
    session = Session("contact", num_robots=4)
    session.move_setpoint(1.0, 0.0)
    run(session, 0.5)
    session.robots[2].push([20.0, 0.0, 0.0])
    while not session.notices:
        session.step()
        assert session.time < 20.0
    assert session.notices[-1] == "robot 2 fell and starts again"
    assert np.array_equal(session.setpoint, [1.0, 0.0])
    run(session, 15.0)
    np.testing.assert_allclose(session.frame().states[:, :2], np.tile([1.0, 0.0], (4, 1)), atol=0.02)


def test_on_a_curve_the_status_has_the_distance_from_the_curve():
    """The setpoint leads the robot by far more than the robot's error."""
    session = Session()
    session.follow("circle")
    for _ in range(round(4.0 / session.driver.control_dt)):
        session.step()
    frame = session.frame()
    ball = frame.states[0, BALL_POSITION][:2]
    assert np.linalg.norm(frame.setpoint - ball) > 0.05
    # The circle begins at the setpoint, its center is a radius away.
    center = frame.route.mean(axis=0)
    off = abs(np.linalg.norm(ball - center) - RADIUS)
    assert off < 0.03
    shown = float(_goal_of(session, frame).split("ball ")[1].split(" m")[0])
    assert shown == pytest.approx(off, abs=0.006)
