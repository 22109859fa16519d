"""Routes of the setpoint, a robot to compare with, links, and files of a recording."""

import io
import shutil
from pathlib import Path

import numpy as np
import pytest

from ballbot_rs import Params
from ballbot_rs._progress import no_progress
from ballbot_rs.viewer.server import link
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.session.balancing import ROUTE_SPEED, Route
from tests.support.paths import ASSETS


@pytest.mark.parametrize("name", ["circle", "eight"])
def test_a_route_is_closed_begins_at_its_point_and_keeps_to_its_speed(name):
    route = Route(name, (0.3, -0.2), ROUTE_SPEED)
    np.testing.assert_allclose(route.at(0.0), (0.3, -0.2), atol=1e-12)
    times = np.linspace(0.0, 30.0, 3001)
    speeds = np.linalg.norm(np.diff([route.at(t) for t in times], axis=0), axis=1) / 0.01
    assert 0.95 * ROUTE_SPEED < speeds.max() <= ROUTE_SPEED * (1.0 + 1e-9)


@pytest.mark.slow("a long drive")
@pytest.mark.parametrize(("name", "robot"), [("circle", "paper"), ("eight", "kugle")])
def test_a_robot_follows_a_route_without_falling_and_a_goal_ends_it(name, robot):
    session = Session(robot=robot)
    session.follow(name)
    curve = session.frame().route
    session.advance(20.0)
    assert not session.robots.fallen.any()
    ball = session.robots.states[0].ball_position[:2]
    assert np.linalg.norm(curve - ball, axis=1).min() < 0.05
    assert np.linalg.norm(session.setpoint - ball) < 0.6
    session.move_setpoint(0.1, 0.0)
    assert session.frame().route is None


def test_actions_on_a_robot_also_apply_to_its_ghost():
    session = Session(start := "contact")
    assert start == session.robots.model
    session.compare_with("lqr")
    session.advance(0.5)
    session.push(0.4, 0.2)
    session.change(body_mass=1.2)
    session.move_setpoint(0.2, 0.1)
    session.advance(2.0)
    frame = session.frame()
    # The same controller on the same robot moves alike, but for the rounding of the state that it begins in.
    np.testing.assert_allclose(frame.ghost.state, frame.states[0], atol=1e-6)
    session.compare_with("pid")
    session.advance(2.0)
    assert np.linalg.norm(session.frame().ghost.state - session.frame().states[0]) > 0.01
    session.choose(robot="rezero")
    assert session.ghost.robots.name == "rezero"


def test_a_link_brings_another_session_to_the_same_choice():
    first = Session(robot="rezero", model="rigid", controller="pid", num_robots=4)
    first.change(wheel_friction=0.8, motor_delay=20.0)
    first.compare_with("lqr")
    first.set_speed(2.0)
    second = Session()
    link.restore(second, link.query_of(first))
    assert link.query_of(second) == link.query_of(first)
    assert second.changes == first.changes


def test_a_link_may_name_only_policies_of_the_package(tmp_path):
    pytest.importorskip("onnxruntime")
    first, second = Session(controller=str(ASSETS / "policies/balance.onnx")), Session()
    assert "policy=balance" in link.query_of(first)
    link.restore(second, link.query_of(first))
    assert Path(second.controller).samefile(first.controller)
    mine = shutil.copy(ASSETS / "policies/balance.onnx", tmp_path)
    assert "policy" not in link.query_of(Session(controller=str(mine)))


@pytest.mark.parametrize(
    "query",
    ["policy=../balance", "policy=mine", "policy=balance&controller=lqr", "controller=/etc/passwd", "compare=a.onnx",
     "other=1", "robot=paper&robot=kugle", "x" * 2000, "body_mass=9", "speed=nan", "num_robots=1e9"],
)  # fmt: skip
def test_a_foreign_link_is_rejected(query):
    with pytest.raises(ValueError, match=r"link|out of range|invalid literal"):
        link.restore(Session(), query)


def test_a_recording_has_a_row_of_each_payload_that_comes_or_goes():
    pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")
    from ballbot_rs.viewer.server.download import Recorded

    paper = Params.paper()
    loaded = paper.with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=90.0)
    for before, after in ((paper, loaded), (loaded, paper)):
        session = Session(params=before)
        session.start_recording()
        session.push(0.0, 0.5)
        session.advance(0.4)
        count = len(session.recording.frames)
        session.set_params(after)
        session.push(0.0, 0.5)
        session.advance(0.4)
        trajectory = Recorded.of(session).trajectory()
        assert trajectory.payloads.shape == (len(trajectory.times), 2, 6)
        moved = np.abs(trajectory.payloads[:, 0, 0]) > 1e-6
        assert moved[: count - 1].any() == before.has_payload
        assert moved[count + 1 :].any() == after.has_payload


def test_robots_show_their_own_payloads():
    robot = Params.paper().replace(payload_stiffness=[30.0] * 3, payload_position=[0.0, 0.0, 0.3])
    session = Session(params=robot, num_robots=3, events=[{"term": "payload_mass", "range": [0.1, 0.9]}])
    session.advance(0.1)
    masses = [params.payload_mass for params, _ in session.frame().loads]
    assert masses == [one.params.payload_mass for one in session.robots]
    assert len(set(masses)) == 3
    assert Session().frame().loads == []


def test_a_recording_becomes_a_table():
    pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")
    from ballbot_rs.viewer.server.download import Recorded, file_of

    session = Session()
    session.start_recording()
    session.advance(1.0)
    frames = session.recording.frames
    trajectory = Recorded.of(session).trajectory()
    text = file_of(trajectory, "CSV", no_progress).decode()
    table = np.genfromtxt(io.StringIO(text), delimiter=",", names=True)
    np.testing.assert_allclose(table["time_s"], [frame.time - frames[0].time for frame in frames], atol=1e-12)
    np.testing.assert_array_equal(np.array(trajectory.to_array())[:, 0], [frame.states[0, 0] for frame in frames])
    assert len(frames) > 90
