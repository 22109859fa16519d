"""The limits of a control barrier on the page."""

import numpy as np
import pytest

from ballbot_rs.scenarios.tune import with_options
from ballbot_rs.viewer.panels.status import rows_of
from ballbot_rs.viewer.session.session import Session
from tests.viewer.test_viewer_session import run

#: A speed limit that `lqr` alone exceeds on 0.3 m.
LIMITS = {"speed_limit": 0.15, "boundary": (-0.5, 1.0, -0.5, 0.5)}


def shown(session):
    return {row.label: row.value for row in rows_of(session, session.frame())}


def test_speed_limit_and_boundary_are_in_the_table():
    rows = shown(Session(controller=with_options("lqr", LIMITS)))
    assert rows["Speed limit"] == "0.15 m/s, 0 % in use"
    assert rows["Boundary"] == "0.50 m away"


def test_the_table_shows_how_fast_the_ball_is():
    session = Session(controller=with_options("lqr", LIMITS))
    session.reset(tilt=(0.0, 0.0))
    session.move_setpoint(0.3, 0.0)
    speeds = []
    for _ in range(60):
        run(session, 0.05)
        speeds.append(np.linalg.norm(session.frame().states[0, 7:9]) / LIMITS["speed_limit"])
        assert shown(session)["Speed limit"] == f"0.15 m/s, {100.0 * speeds[-1]:.0f} % in use"
    assert 0.8 <= max(speeds) < 1.0


def test_the_table_shows_how_far_from_the_boundary_the_ball_stops():
    session = Session(controller=with_options("lqr", {"boundary": LIMITS["boundary"]}))
    session.move_setpoint(3.0, 0.0)
    run(session, 12.0)
    assert 0.0 < float(shown(session)["Boundary"].removesuffix(" m away")) < 0.06


def test_a_ball_that_a_push_drives_across_the_boundary_is_beyond_it():
    session = Session(controller=with_options("lqr", {"boundary": (-0.15, 0.15, -0.15, 0.15)}))
    session.push(0.0, 1.5)
    values = []
    for _ in range(30):
        run(session, 0.05)
        values.append(shown(session)["Boundary"])
    assert any(value.endswith("beyond") for value in values)


def test_laws_without_limits_show_none():
    session = Session()
    assert not {"Speed limit", "Boundary"} & set(shown(session))
    assert session.frame().boundary is None


def test_the_boundary_is_a_rectangle_on_the_floor():
    viser = pytest.importorskip("viser")
    from ballbot_rs.viewer.scene.boundary import BoundaryLine

    server = viser.ViserServer(port=0, verbose=False)
    try:
        line = BoundaryLine(server, "/boundary")
        session = Session(controller=with_options("lqr", LIMITS))
        line.show(session.frame())
        points = line._line.points.reshape(-1, 3)
        assert line._line.visible
        np.testing.assert_allclose([points[:, 0].min(), points[:, 0].max()], [-0.5, 1.0])
        np.testing.assert_allclose([points[:, 1].min(), points[:, 1].max()], [-0.5, 0.5])
        line.show(Session().frame())
        assert not line._line.visible
    finally:
        server.stop()
