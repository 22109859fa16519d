"""What the page shows and commands, without a browser: clicks, ghost, policies, words, camera, colors, looks."""

import math

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from ballbot_rs import Params
from ballbot_rs._state_rows import BODY_QUATERNION
from ballbot_rs.viewer.panels.plots import COLORS, LIMIT_COLOR
from ballbot_rs.viewer.panels.robot import POLICY, RobotPanel, listed
from ballbot_rs.viewer.panels.status import html_of, metrics_of, rows_of, velocity_of
from ballbot_rs.viewer.scene import heading, look
from ballbot_rs.viewer.scene.cameras import CHASE, FOLLOW, FREE, Camera
from ballbot_rs.viewer.server.link import parts_of, query_of, restore
from ballbot_rs.viewer.server.teleop import Report, message_of
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.session.policies import shipped, shipped_name
from ballbot_rs.viewer.session.recording import SERIES, Commands
from ballbot_rs.viewer.view import View
from tests.support.view import query
from tests.support.waiting import wait_until
from tests.viewer.test_viewer_session import run


@pytest.mark.parametrize(("click", "near"), [((7.1234567, -0.5), (5.0, -0.5)), ((-6.0, 9.0), (-5.0, 5.0))])
def test_a_far_click_is_brought_to_the_edge_of_the_setpoints(click, near):
    session = Session()
    session.click(*click)
    np.testing.assert_array_equal(session.setpoint, near)
    x, y = click
    expected = (
        f"({x:.3g}, {y:.3g}) m is too far: set to ({near[0]:.3g}, {near[1]:.3g}) m, the limit is 5 m along x and y"
    )
    assert list(session.notices) == [expected]


def test_a_far_click_is_brought_to_the_largest_distance_of_a_goal():
    session = Session(task="goal")
    limit = session.commanding.max_distance
    session.click(30.0, 40.0)
    np.testing.assert_allclose(session.frame().commands.values[0], np.array([0.6, 0.8]) * limit, atol=1e-9)
    assert session.notices[-1].endswith(f"the limit is {limit:.3g} m from the ball")


def test_a_near_click_is_taken_without_a_message():
    for task in ("balance", "goal"):
        session = Session(task=task)
        session.click(0.3, -0.2)
        assert not session.notices
    with pytest.raises(ValueError, match="nan"):
        session.click(math.nan, 0.0)


def test_a_program_gets_an_error_for_a_far_setpoint():
    with pytest.raises(ValueError, match=r"x = 7\.0 is out of range"):
        Session().move_setpoint(7.0, 0.0)


def test_a_replay_has_the_ghost_and_its_numbers():
    session = Session()
    session.compare_with("pid")
    session.start_recording()
    session.push(0.0, 0.2)
    run(session, 1.0)
    live = [session.ghost.robots.states[0].to_array()]
    session.replay(session.recording.duration)
    frame = session.frame()
    np.testing.assert_array_equal([frame.ghost.state], live)
    assert (frame.label, frame.ghost.label) == ("lqr", "pid")
    position = next(row for row in rows_of(session, frame) if row.label == "Position")
    x, y = frame.ghost.state[:2]
    assert position.ghost == f"({x:.2f}, {y:.2f}) m" != position.value
    shown = html_of(session, frame, "")
    assert 'class="is-ghost"' in shown
    session.compare_with(None)
    session.end_replay()
    assert 'class="is-ghost"' not in html_of(session, session.frame(), "")


def test_the_plots_have_the_ghost():
    session = Session()
    session.compare_with("pid")
    session.push(0.0, 0.2)
    run(session, 0.5)
    series = session.history.series()
    at_last = {name: series[SERIES[name], -1] for name in ("tilt", "position", "speed")}
    for name, value in at_last.items():
        ghost = series[SERIES[f"ghost {name}"], -1]
        assert np.isfinite(ghost).all()
        assert np.abs(ghost - value).max() > 1e-4
    session.compare_with(None)
    run(session, 0.1)
    assert np.isnan(session.history.series()[SERIES["ghost tilt"], -1]).all()


def test_a_repeated_replay_begins_again():
    session = Session()
    session.start_recording()
    run(session, 1.0)
    session.replay(0.9)
    session.repeats = True
    session.advance(0.2)
    assert session.replay_time == 0.0


@pytest.mark.parametrize("name", shipped())
def test_shipped_policies_are_listed_by_name(name):
    path = str(shipped()[name])
    assert shipped_name(path) == name
    assert listed(path) == f"policy: {name}"
    assert parts_of(f"compare={name}") == {"compare": name}


@pytest.mark.slow("loads and tries policies")
def test_a_policy_is_chosen_from_the_list_and_in_a_link():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    view = View(Session(), port=18760)
    try:
        panel: RobotPanel = view._page.robot
        names = set(panel.controller.options)
        assert {f"policy: {name}" for name in shipped()} | {POLICY, "lqr"} <= names
        assert not panel.policy.visible
        path = panel._source("policy: balance")
        query(view, lambda session: session.choose(controller=path))
        query(view, lambda session: session.compare_with(path))
        wait_until(lambda: (panel.controller.value, panel.ghost.value) == ("policy: balance",) * 2)
        link = query(view, query_of)
        assert {"policy=balance", "compare=balance"} <= set(link.split("&"))
        query(view, lambda session: session.choose(controller="lqr"))
        query(view, lambda session: restore(session, link))
        assert query(view, lambda session: (session.controller, session.ghost.controller)) == (path, path)
    finally:
        view.stop()


def test_commands_are_words():
    assert velocity_of(0.3, -0.1, 0.5) == "0.30 m/s forward, 0.10 m/s right, 0.50 rad/s turning left"
    assert velocity_of(-0.3, 0.0, -0.001) == "0.30 m/s back"
    assert velocity_of(-0.0, 0.0, 0.0) == "stay at rest"


def test_metrics_are_words_with_explanations():
    numbers = {"velocity_error": 0.01, "yaw_rate_error": math.nan, "share": 0.978, "level": 2.0}
    nothing = np.zeros((1, 3))
    rows = {row.label: row for row in metrics_of(Commands("terrain", *[nothing] * 4, numbers, False))}
    assert [row.value for row in rows.values()] == [
        "0.010 m/s",
        "not yet",
        "98 % of the commanded distance",
        "level 2",
    ]
    assert rows["Progress"].hint == (
        "distance of the ball in the commanded direction, over the smoothed command's; of the episode so far"
    )


@pytest.fixture
def state():
    return Session().frame().states[0].copy()


def with_heading(state, yaw):
    turned = state.copy()
    turned[BODY_QUATERNION] = heading.about_z(yaw)
    return turned


def test_a_chasing_camera_turns_with_the_heading(state):
    camera, middle = Camera(), np.array([0.4, -0.2, 0.0])
    camera.follow(middle, with_heading(state, 1.0))
    assert camera.turn == 0.0
    np.testing.assert_allclose(camera.point((0.0, 0.0, 0.0)), middle)
    camera.kind = CHASE
    for _ in range(200):
        camera.follow(middle, with_heading(state, 3.0))
    assert camera.turn == pytest.approx(3.0)
    # Through half a turn it takes the short way.
    camera.follow(middle, with_heading(state, -3.0))
    assert 3.0 < camera.turn < 3.1
    for _ in range(200):
        camera.follow(middle, with_heading(state, -3.0))
    # What is ahead of the camera is ahead of the robot.
    ahead = np.array([math.cos(3.0), -math.sin(3.0), 0.0])
    np.testing.assert_allclose(camera.vector((1.0, 0.0, 0.0)), ahead, atol=1e-6)
    np.testing.assert_allclose(camera.point((1.0, 0.0, 0.0)), middle + ahead, atol=1e-6)
    camera.kind = FREE
    assert camera.follow(middle, state)
    assert camera.turn == 0.0


def test_pages_report_colors_and_the_key_of_the_camera():
    assert message_of('{"dark": true}') == Report(dark=True)
    assert message_of('{"chase": true}') == Report(chase=True)
    assert message_of('{"dark": 1}') is None
    view = View(Session(), port=18765)
    try:
        page, scene = view._page, view._page._scene
        query(view, lambda _: page.reported(Report(dark=True)))
        assert max(scene._ground._grid.plane_color) < 80
        # A choice of the user overrides the system.
        query(view, lambda _: (setattr(page.display._colors, "value", "light"), page.reported(Report(dark=True))))
        assert min(scene._ground._grid.plane_color) > 200
        query(view, lambda _: page.reported(Report(chase=True)))
        assert (scene.camera.kind, page.display._camera.value) == (CHASE, CHASE)
        query(view, lambda _: page.reported(Report(chase=True)))
        assert scene.camera.kind == FOLLOW
    finally:
        view.stop()


@pytest.mark.parametrize("background", ["#ffffff", "#242424"])
def test_curves_have_a_contrast_of_three(background):
    def luminance(color):
        parts = [int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return np.dot((0.2126, 0.7152, 0.0722), linear)

    for color in (*COLORS, LIMIT_COLOR):
        low, high = sorted((luminance(color), luminance(background)))
        assert (high + 0.05) / (low + 0.05) >= 3.0


def test_the_colors_of_the_ball_meet_at_edges_of_its_triangles():
    first, second = look.ball_of(0.1)
    for one, sign in ((first, 1.0), (second, -1.0)):
        triangles = one.vertices[one.faces]
        # Each triangle is in one octant, with its outside outwards.
        assert ((sign * triangles.mean(axis=1).prod(axis=1)) > 0.0).all()
        assert (np.abs(triangles).min(axis=(1, 2)) >= 0.0).all()
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        assert (np.einsum("ij,ij->i", normals, triangles.mean(axis=1)) >= -1e-15).all()
        np.testing.assert_allclose(np.linalg.norm(one.vertices, axis=1), 0.1)


@pytest.mark.parametrize("name", Params.preset_names())
def test_the_cone_is_at_the_front_of_the_body(name):
    made = look.from_params(Params.preset(name))
    cone = heading.on_body(made)
    body = np.concatenate([piece.vertices for piece in made.body])
    tip = cone.vertices[cone.vertices[:, 0].argmax()]
    assert abs(tip[1]) < 1e-12
    assert tip[2] > 0.5 * body[:, 2].max()
    assert tip[0] == pytest.approx(cone.vertices[:, 0].min() + heading.CONE[0])


def test_published_robots_have_shapes_with_their_published_dimensions():
    heights = {"kugle": 1.11, "asroballet": 1.062 + 0.075}
    for name, height in heights.items():
        body = np.concatenate([piece.vertices for piece in look.from_params(Params.preset(name)).body])
        assert body[:, 2].max() == pytest.approx(height, abs=0.02)
    changed = Params.preset("kugle").replace(wheel_radius=0.055)
    assert {piece.color for piece in look.from_params(changed).body} < {
        piece.color for piece in look.from_params(Params.preset("kugle")).body
    }
