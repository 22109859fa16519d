"""Obstacles of terrains: how they are given, kept, drawn and seen. tests/rust/core/obstacles.rs has the physics."""

import math
import pickle

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.viewer.scene.obstacles import obstacle_mesh

POST = {"kind": "post", "x": 0.8, "radius": 0.1, "height": 1.0}
BOX = {"kind": "box", "y": -1.0, "yaw": 0.5, "height": 0.4}
WALL = {"kind": "wall", "x": -1.0}


def level(*obstacles):
    return bb.Terrain.plane(0.0).with_obstacles(obstacles)


def test_obstacles_survive_recipes_pickles_and_options():
    terrain = level(POST, BOX).with_obstacles([WALL])
    assert [one["kind"] for one in terrain.obstacles] == ["post", "box", "wall"]
    assert terrain.obstacles[0]["friction"] == bb.obstacle_kinds()["post"]["friction"]["default"]
    assert pickle.loads(pickle.dumps(terrain)) == terrain
    assert bb.Terrain.generate(**terrain.recipe) == terrain
    batch = bb.Batch(2, "balance", terrain=terrain.recipe)
    assert batch.terrain == terrain
    hills = bb.Terrain.from_function(lambda x, y: 0.02 * np.sin(x + y), (4.0, 4.0), 0.1).with_obstacles([POST])
    assert pickle.loads(pickle.dumps(hills)) == hills
    assert hills != hills.with_obstacles([POST])
    posts = bb.Terrain.generate("posts", 3)
    assert "obstacles" not in posts.recipe
    assert len(posts.with_obstacles([WALL]).obstacles) == len(posts.obstacles) + 1
    assert "1 obstacle," not in repr(posts)


def test_distances_are_from_outlines():
    x = np.array([0.0, 0.8, -0.9])
    np.testing.assert_allclose(level(POST, WALL).obstacle_distance(x, 0.0), [0.7, -0.1, 0.1], atol=1e-12)
    assert bb.Terrain.plane(0.0).obstacle_distance(0.0, 0.0) == math.inf


@pytest.mark.parametrize(
    ("obstacles", "words"),
    [
        ([{"kind": "tree"}], "tree"),
        ([{"x": 1.0}], "obstacles\\[0\\] needs its 'kind'"),
        ([POST, {"kind": "post", "depth": 1.0}], "depth"),
        ([{"kind": "post", "radius": -1.0}], "obstacles\\[0\\].*radius = -1"),
        ([{"kind": "wall", "restitution": 0.6}], "restitution = 0.6"),
        ([POST] * 4097, "4097"),
        ([5], "obstacles\\[0\\] must be a dict"),
        (5, "list of dicts"),
        (POST, "list of dicts"),
        ([{"kind": "post", "x": "far"}], "x of obstacles\\[0\\] must be a number"),
    ],
)
def test_bad_obstacles_are_named(obstacles, words):
    with pytest.raises((ValueError, TypeError), match=words):
        bb.Terrain.plane(0.0).with_obstacles(obstacles)


def test_what_has_no_obstacles_rejects_them(tmp_path):
    terrain = level(POST)
    for model in ("spatial", "planar"):
        with pytest.raises(ValueError, match=r"obstacles|level ground"):
            bb.Ballbot(model=model, terrain=terrain)
    with pytest.raises(ValueError, match="1 obstacles"):
        MujocoRobot(robot_geometry(bb.Params.paper()), accurate(), terrain)
    hills = bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05).with_obstacles([POST])
    with pytest.raises(ValueError, match="1 obstacles"):
        bb.write_terrain(hills, tmp_path / "hills.stl")
    with pytest.raises(ValueError, match="nearest obstacle"):
        bb.Ballbot(terrain=level({**POST, "x": 0.1}))
    # A wheel reaches beyond the side of the body.
    with pytest.raises(ValueError, match="distance of the wheels from the nearest obstacle"):
        bb.Ballbot(terrain=level({**BOX, "y": 0.0, "x": 0.64, "yaw": 0.0, "width": 4.0, "height": 5.0}))


def test_a_robot_that_gets_no_place_is_unchanged():
    robot = bb.Ballbot(terrain=level({**WALL, "x": -0.17}))
    robot.step([0.1, 0.0, 0.0], 30)
    before = robot.state
    for change in (
        lambda: robot.set_terrain(level({**POST, "x": 0.0})),
        lambda: robot.set_params(robot.params.replace(ball_radius=0.18)),
    ):
        with pytest.raises(ValueError, match="nearest obstacle"):
            change()
        assert robot.state == before
        assert robot.time == pytest.approx(0.03)
    robot.step([0.1, 0.0, 0.0], 30)
    assert robot.params.ball_radius == bb.Params.paper().ball_radius


def test_a_robot_that_drives_against_a_wall_leans_on_it():
    """Its body touches first; both models have the same motion."""
    wall = level({**WALL, "x": 0.4, "yaw": math.pi})
    paths = [
        bb.simulate("lqr", model=model, terrain=wall, reference={"position": (0.6, 0.0)}, seconds=5.0)
        for model in ("contact", "rigid")
    ]
    ball = np.array([[state.ball_position[0] for state in path.states] for path in paths])
    touched = np.array([[contacts.on_obstacle for contacts in path.contacts] for path in paths])
    assert ball.max() < 0.4 - bb.Params.paper().ball_radius
    assert touched.sum(axis=1).min() > 250
    assert abs(ball[0] - ball[1]).max() < 2e-3


def test_a_lidar_sees_obstacles():
    lidar = {
        "beams": 4,
        "field_of_view": 2.0 * math.pi,
        "depression": 0.0,
        "max_range": 5.0,
        "position": (0.0, 0.0, 0.3),
    }
    batch = bb.Batch(1, "balance", terrain=level(POST, WALL), lidar=lidar)
    batch.reset(starts=[bb.State.at_rest(batch.params(0))])
    seen = batch.perceived("lidar", 0)
    angles = ((np.arange(4) + 0.5) / 4 - 0.5) * 2.0 * math.pi
    expected = [5.0 if math.cos(angle) > 0.0 else 1.0 / -math.cos(angle) for angle in angles]
    np.testing.assert_allclose(seen, expected, rtol=1e-5)


def test_pictures_show_obstacles():
    renderer = bb.Renderer(width=64, height=48, terrain=level(POST, WALL))
    labels = renderer.labels(bb.State.at_rest(bb.Params.paper()))
    assert (labels == bb._core.LABELS.index("obstacle")).any()


def test_the_page_has_the_triangles_of_all_obstacles():
    vertices, faces = obstacle_mesh(level(POST, BOX, WALL))
    assert faces.max() < len(vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert high[0] == pytest.approx(0.9, abs=1e-9)
    assert high[2] == pytest.approx(1.0)
    assert low[0] == pytest.approx(-1.1)
    assert low[2] == pytest.approx(-0.5)
    assert obstacle_mesh(bb.Terrain.plane(0.0)) is None
