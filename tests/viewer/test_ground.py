"""Sessions on uneven ground: robots stand on it, leave it and start anew, and rays meet it where it is."""

import numpy as np
import pytest

from ballbot_rs import Terrain
from ballbot_rs.viewer.effects import FORCE_LENGTH, force_arrows
from ballbot_rs.viewer.ground import ray_meets
from ballbot_rs.viewer.ground_nodes import HALF, patch
from ballbot_rs.viewer.session import Session

HILLS = {"kind": "noise", "slope": 0.1, "seed": 3}


def gap_of(session):
    """From the ground to the ball along the vertical, less what that is on a slope, m."""
    state, params = session.robots.states[0], session.robots.params_of(0)
    x, y, z = state.ball_position
    below = np.array([x, y]) - params.ball_radius * session.robots.setup.terrain.normal(x, y)[:2]
    return z - params.ball_radius * session.robots.setup.terrain.normal(*below)[2] - session.frame().heights(below)


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_a_robot_stands_on_the_ground_and_starts_in_its_lean(model):
    session = Session(model=model, task_options={"terrain": HILLS})
    session.reset([0.0, 0.0])
    start = session.robots.states[0]
    assert start.ball_position[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert abs(gap_of(session)) < 1e-3
    session.advance(4.0)
    assert not session.robots.fallen.any()
    assert abs(gap_of(session)) < 1e-3


def test_the_task_terrain_has_its_own_ground_for_each_robot_and_a_tile_to_start_on():
    session = Session(task="terrain")
    paper = session.robots.setup.terrain
    session.advance(3.0)
    assert session.robots.setup.terrain is paper
    session.choose(robot="kugle")
    assert session.robots.setup.terrain.slope != paper.slope
    tile = np.asarray(session.robots.states[0].ball_position[:2])
    np.testing.assert_allclose(tile % 4.0, 0.0, atol=1e-9)
    session.drive(1.0, 0.0, 0.0)
    session.advance(1.0)
    assert session.robots.commands[0, 0] > 0.1


def test_who_leaves_the_ground_starts_anew_on_it():
    session = Session(task="terrain")
    middle = session.robots.states[0].ball_position[:2].copy()
    session.push(0.0, 20.0)
    session.advance(6.0)
    notes = list(session.notices)
    assert any("left its ground" in note or "fell" in note for note in notes), notes
    assert np.abs(session.robots.states[0].ball_position[:2] - middle).max() < 60.0


def test_level_ground_and_back_begin_anew_and_a_ghost_stands_on_the_same():
    session = Session(task_options={"terrain": HILLS})
    ground = session.robots.setup.terrain
    session.compare_with("lqi")
    assert session.ghost.robots.setup.terrain == ground
    session.advance(1.0)
    session.choose(task="openballbot")
    assert session.robots.setup.terrain == ground
    with pytest.raises(ValueError, match="num_robots = 4: there is one robot on uneven ground"):
        session.choose(num_robots=4)
    assert len(session.robots) == 1


@pytest.mark.parametrize("wrong", [{"kind": "noise", "slope": 2.0}, {"kind": "lava"}])
def test_ground_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=r"slope|lava"):
        Session(task_options={"terrain": wrong})


def test_models_without_ground_of_their_own_refuse_it_and_nothing_changes():
    session = Session(task_options={"terrain": HILLS})
    with pytest.raises(ValueError, match=r"planar|level"):
        session.choose(model="planar")
    assert session.robots.model == "contact"
    session.advance(0.5)


def test_a_ray_meets_the_ground_where_it_is():
    ground = Terrain.generate("noise", **{name: value for name, value in HILLS.items() if name != "kind"})
    eye = np.array([-2.0, -2.5, 1.5])
    for x, y in [(0.0, 0.0), (0.7, 0.4), (-1.0, 1.2)]:
        point = np.array([x, y, float(ground.height(x, y))])
        found = ray_meets(ground, eye, point - eye)
        way = np.linalg.norm(np.array(found) - eye[:2])
        # A hill before it may hide the point.
        assert way <= np.linalg.norm(point[:2] - eye[:2]) + 1e-3
        assert found == pytest.approx((x, y), abs=2e-3) or way < np.linalg.norm(point[:2] - eye[:2]) - 0.02
    assert ray_meets(ground, eye, np.array([0.0, 0.0, 1.0])) is None
    assert ray_meets(ground, np.array([0.0, 0.0, -5.0]), np.array([1.0, 0.0, -0.1])) is None


def test_the_patch_is_the_ground():
    ground = Terrain.plane(0.1, 0.5)
    points = patch(ground, np.array([3.0, -1.0]))
    assert np.ptp(points[..., 0]) == pytest.approx(2.0 * HALF)
    np.testing.assert_allclose(points[..., 2], ground.height(points[..., 0], points[..., 1]))


def test_the_arrow_of_the_floor_is_along_the_slope():
    session = Session(task_options={"terrain": Terrain.plane(0.1)})
    session.advance(3.0)
    frame = session.frame()
    tail, tip = force_arrows(frame)[-1]
    normal = frame.terrain.normal(0.0, 0.0)
    assert (tip - tail) @ normal == pytest.approx(0.0, abs=1e-9)
    params = frame.params
    weight = (params.body_mass + params.ball_mass) * params.gravity
    assert np.linalg.norm(tip - tail) == pytest.approx(FORCE_LENGTH * weight * np.sin(0.1), rel=0.02)
