"""`bb.show_crowd`: robots that touch each other on a page."""

import types
import urllib.request

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

import ballbot_rs as bb

pytestmark = pytest.mark.slow("real time")

POST = bb.Terrain.plane(0.0).with_obstacles([{"kind": "post", "x": 2.0}])


def _wait_until(page, condition) -> None:
    for _ in range(400):
        if condition():
            return
        page.wait(0.05)
    raise AssertionError("waited in vain")


def test_robots_stand_are_pulled_and_pushed_by_each_other() -> None:
    crowd = bb.Crowd(["paper", "kugle"], [(0.0, 0.0), (0.5, 0.0)], terrain=POST)
    laws = [bb.Lqr(params, control_dt=0.01) for params in crowd.params]
    with bb.show_crowd(crowd, laws, port=18980) as page:
        with urllib.request.urlopen(page.url, timeout=10) as answer:
            assert answer.status == 200
        _wait_until(page, lambda: page.time > 1.0)
        assert max(state.tilt for state in page.states) < 0.01
        np.testing.assert_allclose([state.ball_position[0] for state in page.states], (0.0, 0.5), atol=0.01)
        # A drag of the first robot to the right pulls it into the second.
        at = (0.0, 0.0, 0.0)
        drag = types.SimpleNamespace(start_position=at, end_position=(0.6, 0.0, 0.0), phase="update")
        page._dragged(0, drag)
        _wait_until(page, lambda: page.states[1].ball_position[0] > 0.52)
        page._dragged(0, types.SimpleNamespace(start_position=at, end_position=at, phase="end"))
        assert not page._pulled
        page.reset()
        _wait_until(page, lambda: page.time > 0.5)
        assert abs(page.states[1].ball_position[0] - 0.5) < 0.02
        for call, words in (
            (lambda: page.pull(2, None), "robot = 2 is out of range"),
            (lambda: page.pull(0, (1.0, 2.0)), "three finite numbers"),
        ):
            with pytest.raises(ValueError, match=words):
                call()
    assert page._error is None


def test_a_law_that_fails_is_reported() -> None:
    crowd = bb.Crowd(["paper"], [(0.0, 0.0)])
    page = bb.show_crowd(crowd, [lambda _: [np.nan, 0.0, 0.0]], port=18981)
    with page, pytest.raises(RuntimeError, match="has stopped"):
        page.wait(2.0)


def test_bad_arguments_are_rejected() -> None:
    crowd = bb.Crowd(["paper"], [(0.0, 0.0)])
    with pytest.raises(ValueError, match="laws has 0 entries, expected 1"):
        bb.show_crowd(crowd, [])
    with pytest.raises(ValueError, match="port = 0"):
        bb.show_crowd(crowd, [bb.Lqr(control_dt=0.01)], port=0)
