"""Drawings and clicks of tasks in Python on the page."""

import time

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.viewer.scene.arrows import open_line
from ballbot_rs.viewer.session.session import Session


class Chase(bb.Task):
    """Goes where the floor is clicked."""

    def __init__(self):
        self.goals = {}

    def reset(self, robots, chosen, rngs):  # noqa: ARG002
        for i, rng in zip(chosen.tolist(), rngs, strict=True):
            self.goals[i] = rng.uniform(-1.0, 1.0, 2)

    def error(self, robots):
        return np.array([self.goals[i] for i in robots.numbers.tolist()]) - robots.ball_position[:, :2]

    def observe(self, robots):
        return np.column_stack([robots.gravity, self.error(robots)])

    def reward(self, robots):
        return -np.linalg.norm(self.error(robots), axis=1)

    def drawing(self, robots):
        return (robots.ball_position[:, :2] + self.error(robots))[:, None]

    def click(self, robots, point):
        for i in robots.numbers.tolist():
            self.goals[i] = point


@pytest.fixture
def registered():
    names = []

    def register(task):
        names.append(f"test/Drawn{len(names)}-v0")
        bb.register(names[-1], task)
        return names[-1]

    return register


def test_a_click_is_a_goal_of_a_task_in_python(registered):
    session = Session(task=registered(Chase), num_robots=2)
    assert session.takes_clicks
    first = session.frame().commands.drawings
    assert [one.shape for one in first] == [(1, 2), (1, 2)]
    assert not np.array_equal(*first)
    session.click(0.3, -0.2)
    for robot in session.robots:
        np.testing.assert_allclose(robot.drawing, [[0.3, -0.2]], atol=1e-6)
        np.testing.assert_allclose(robot._batch.stage.task.goals[0], [0.3, -0.2])
    session.step()
    # The policy observes it.
    np.testing.assert_allclose(session.robots.observations[:, 3:], [[0.3, -0.2]] * 2, atol=1e-2)
    for one in session.frame().commands.drawings:
        np.testing.assert_allclose(one, [[0.3, -0.2]], atol=1e-6)
    # The next episode samples a goal.
    session.reset()
    assert np.abs(np.array(session.frame().commands.drawings) - (0.3, -0.2)).min(axis=2).min() > 1e-3


def test_a_task_without_these_methods_has_neither(registered):
    class Plain(Chase):
        drawing, click = bb.Task.drawing, bb.Task.click

    session = Session(task=registered(Plain))
    assert not session.takes_clicks
    assert session.frame().commands.drawings == []
    with pytest.raises(ValueError, match="a click is not a command of the task"):
        session.click(0.3, 0.0)


def test_a_wrong_drawing_is_an_error_where_the_task_is_chosen(registered):
    class Flat(Chase):
        def drawing(self, robots):
            return np.zeros((len(robots), 2))

    with pytest.raises(ValueError, match=r"Flat\.drawing returned shape \(1, 2\), expected \(1, k, 2\)"):
        Session(task=registered(Flat))


def test_a_drawing_that_fails_is_hidden_and_the_robots_continue(registered):
    class Failing(Chase):
        def drawing(self, robots):
            if robots.time[0] > 0.0:
                raise RuntimeError("no chalk")
            return super().drawing(robots)

    session = Session(task=registered(Failing))
    with pytest.warns(UserWarning, match="is no longer drawn: no chalk"):
        session.step()
    session.step()
    assert session.frame().commands.drawings == []


def test_a_line_is_interrupted_by_nan():
    nan = [np.nan, np.nan]
    ground = bb.Terrain.generate("wave")
    points = np.array([[0.0, 0.0], [1.0, 0.0], nan, [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])
    segments = open_line(points, lambda places: ground.height(*places.T))
    assert segments[:, :, :2].tolist() == [[[0, 0], [1, 0]], [[2, 0], [2, 1]], [[2, 1], [2, 2]]]
    assert segments[0, 1, 2] == pytest.approx(ground.height(1.0, 0.0), abs=0.01)
    assert open_line(np.array([[1.0, 2.0]]), lambda places: np.zeros(len(places))).shape == (0, 2, 3)


@pytest.mark.slow("real time")
def test_the_page_draws_a_line(registered):
    pytest.importorskip("viser", reason="needs 'ballbot-rs[viewer]'")

    class Road(Chase):
        def drawing(self, robots):
            return np.broadcast_to(np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 0.0]]), (len(robots), 3, 2))

    with bb.show("lqr", task=registered(Road), open_browser=False) as page:
        scene = page._view._page._scene
        limit = time.monotonic() + 10.0
        while not (scene._commands and scene._commands[0]._curve.visible) and time.monotonic() < limit:
            time.sleep(0.02)
        nodes = scene._commands[0]
        np.testing.assert_allclose(nodes._curve.points[:, :, :2], [[[0, 0], [1, 0.5]], [[1, 0.5], [2, 0]]], atol=1e-6)
        assert not nodes._ring.visible
