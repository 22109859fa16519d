"""The limits of a control barrier on the page."""

import numpy as np
import pytest

from ballbot_rs.scenarios.tune import with_options
from ballbot_rs.viewer.panels.status import rows_of
from ballbot_rs.viewer.session.session import Session
from tests.viewer.test_viewer_session import run

LIMITS = {"speed_limit": 0.4, "boundary": (-0.5, 1.0, -0.5, 0.5)}


def shown(session):
    return {row.label: row.value for row in rows_of(session, session.frame())}


def test_speed_limit_and_boundary_are_in_the_table():
    session = Session(controller=with_options("lqr", LIMITS))
    rows = shown(session)
    assert rows["Speed limit"] == "0.40 m/s, 0 % in use"
    assert rows["Boundary"] == "0.50 m away"
    session.move_setpoint(3.0, 0.0)
    words = set()
    for _ in range(120):
        run(session, 0.1)
        words.add(shown(session)["Speed limit"].partition("use")[2])
        assert np.linalg.norm(session.frame().states[0, 7:9]) < 0.4
    # It stops before the boundary, and away from the setpoint.
    left = float(shown(session)["Boundary"].removesuffix(" m away"))
    assert 0.0 < left < 0.06
    assert words <= {"", " (braking)"}


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
