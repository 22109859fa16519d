"""Terrains from Python: their surface, robots and environments on them."""

import copy
import json
import math
import pickle

import gymnasium
import numpy as np
import pytest

import ballbot_rs as bb


def hills(x, y):
    """Heights, m."""
    return 0.05 * np.sin(3.0 * x) * np.cos(2.0 * y)


def test_a_surface_equals_its_function():
    terrain = bb.Terrain.from_function(hills, (4.0, 3.0), 0.02)
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 7), np.linspace(-1.0, 1.0, 5))
    assert terrain.height(x, y).shape == (5, 7)
    np.testing.assert_allclose(terrain.height(x, y), hills(x, y), atol=1e-7)
    np.testing.assert_allclose(terrain.gradient(x, y)[..., 0], 0.15 * np.cos(3 * x) * np.cos(2 * y), atol=1e-5)
    normal = terrain.normal(x, y)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0)
    np.testing.assert_allclose(np.arccos(normal[..., 2]), terrain.slope_at(x, y), atol=1e-7)
    assert terrain.curvatures_at(0.3, 0.2).shape == (2,)
    assert isinstance(terrain.height(0.1, 0.2), float)
    # One number with many.
    assert terrain.height(0.0, np.zeros(3)).shape == (3,)
    assert terrain.size == pytest.approx((4.0, 3.0))
    assert terrain.contains(1.9, -1.4)
    assert not terrain.contains(2.1, 0.0)
    assert terrain.slope == pytest.approx(math.atan(0.15), rel=1e-3)


def test_heights_have_rows_along_y():
    heights = np.zeros((5, 8))
    heights[4, :] = 0.01
    terrain = bb.Terrain.from_heights(heights, 0.1)
    assert terrain.size == pytest.approx((0.7, 0.4))
    assert terrain.height(0.0, 0.2) == pytest.approx(0.01)
    assert terrain.height(0.35, -0.2) == pytest.approx(0.0, abs=1e-12)
    back, cell = terrain.heights()
    np.testing.assert_allclose(back, heights, atol=1e-15)
    assert cell == pytest.approx(0.1)
    assert terrain.heights(0.05)[0].shape == (9, 15)


@pytest.mark.parametrize("kind", list(bb.terrain_kinds()))
def test_a_recipe_reproduces_its_terrain(kind):
    parameters = bb.terrain_kinds()[kind]
    assert all(entry["doc"] and entry["limit"] is not None for entry in parameters.values())
    coarse = {"plane": {}, "levels": {"cell": 0.1}, "hills": {"cell": 0.1}, "posts": {}}.get(
        kind, {"cell": 0.03, "size_x": 4.0, "size_y": 4.0}
    )
    own = {"radius": 0.12} if kind == "posts" else {"slope": 0.12}
    terrain = bb.Terrain.generate(kind, seed=3, **own, **coarse)
    recipe = json.loads(json.dumps(terrain.recipe))
    assert set(recipe) == {"kind", "seed", *parameters}
    again = bb.Ballbot(terrain=recipe).terrain
    assert again == terrain
    for other in (pickle.loads(pickle.dumps(terrain)), copy.deepcopy(terrain)):
        assert other == terrain
    assert kind in repr(terrain)


def test_a_terrain_of_heights_is_pickled():
    terrain = bb.Terrain.from_function(hills, (2.0, 1.0), 0.05)
    assert pickle.loads(pickle.dumps(terrain)) == terrain
    assert terrain.recipe is None
    robot = bb.Ballbot(terrain=terrain)
    robot.place_on_ground(0.2, 0.1)
    robot.step([0.0] * 3, 20)
    for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
        assert other.state == robot.state
    for make in (lambda: bb.BalanceEnv(terrain=terrain), lambda: bb.BalanceVectorEnv(2, terrain=terrain)):
        env = make()
        env.reset(seed=1)
        again = copy.deepcopy(env)
        action = np.zeros(env.action_space.shape, dtype=np.float32)
        np.testing.assert_array_equal(env.step(action)[0], again.step(action)[0])


@pytest.mark.parametrize("kind", list(bb.terrain_kinds()))
def test_every_kind_makes_ground_by_default(kind):
    bb.Ballbot(terrain=kind).place_on_ground(0.1, 0.1)


def test_events_do_not_tilt_a_floor_that_is_a_terrain_nor_make_balls_too_large():
    tilts = [{"term": "floor_tilt", "mode": "reset", "op": "abs", "dist": "uniform", "range": [-0.1, 0.1]}]
    with pytest.raises(ValueError, match="an event changes floor_tilt"):
        bb.BalanceVectorEnv(2, terrain="plane", events=tilts)
    large = [{"term": "ball_radius", "mode": "reset", "op": "abs", "dist": "uniform", "range": [0.112, 0.2]}]
    ground = {"kind": "wave", "wavelength": 0.5, "slope": 0.2}
    limit = 0.5 / bb.Terrain.generate(**ground).curvature[0]
    env = bb.BalanceVectorEnv(64, terrain=ground, events=large)
    env.reset(seed=0)
    radii = [env._batch.params(i).ball_radius for i in range(64)]
    assert max(radii) <= limit
    assert limit < 0.2


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: bb.Terrain.plane(2.0), ValueError, "slope = 2"),
        (lambda: bb.Terrain.generate("lava"), ValueError, "noise"),
        (lambda: bb.Terrain.generate("noise", heigth=1.0), ValueError, "heigth"),
        (lambda: bb.Terrain.generate("noise", slope="steep"), TypeError, "slope must be a number"),
        (lambda: bb.Terrain.generate("noise", seed=-1), ValueError, "seed"),
        (lambda: bb.Terrain.from_heights(np.zeros(9), 0.1), ValueError, "shape"),
        (lambda: bb.Terrain.from_heights([["a"]], 0.1), TypeError, "heights"),
        (lambda: bb.Terrain.from_heights(np.full((4, 4), np.nan), 0.1), ValueError, r"heights\[0, 0\]"),
        (lambda: bb.Terrain.from_function(lambda *_: 0.0, (1.0, 1.0), 0.1), ValueError, "shape"),
        (lambda: bb.Terrain.from_function(hills, (1.0,), 0.1), ValueError, "size"),
        (lambda: bb.Terrain.plane(0.1).heights(), ValueError, "no edges"),
        (lambda: bb.Ballbot(terrain="sea"), ValueError, "unknown kind of terrain 'sea'"),
        (lambda: bb.Ballbot(terrain=3), TypeError, "terrain must be"),
        (lambda: bb.Ballbot(terrain={"seed": 1}), ValueError, "kind"),
        (lambda: bb.Ballbot(terrain={"kind": "noise", "fingerprint": "0"}), ValueError, "pass it as terrain="),
        (lambda: bb.Ballbot(model="planar", terrain=bb.Terrain.plane(0.1)), ValueError, "'planar'"),
        (
            lambda: bb.Ballbot(terrain={"kind": "wave", "wavelength": 0.2, "slope": 0.3}),
            ValueError,
            "narrowest valley has a curvature",
        ),
        (lambda: bb.Ballbot(terrain=bb.Terrain.plane(1.0)).place_on_ground(0, 0), ValueError, "no lean holds"),
        (lambda: bb.Ballbot(terrain=bb.Terrain.plane(0.1)).place_on_ground(math.nan, 0), ValueError, "x = NaN"),
    ],
)
def test_invalid_input_is_rejected(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_exceptions_of_a_function_are_raised():
    def broken(*_):
        raise RuntimeError("no map")

    with pytest.raises(RuntimeError, match="no map"):
        bb.Terrain.from_function(broken, (1.0, 1.0), 0.1)


def test_on_a_slope_a_regulator_drifts_down_and_an_observer_removes_the_drift():
    """The lean observer of docs/controllers.md, on a surface in place of a tilted gravity."""
    ends = {}
    for name, options in {"lqr": {}, "observer": {"lean_observer": 2.0}}.items():
        law = bb.make_controller("lqr", control_dt=0.01, **options)
        path = bb.simulate(law, seconds=8.0, terrain=bb.Terrain.plane(0.05))
        assert path.terrain == bb.Terrain.plane(0.05)
        ends[name] = np.linalg.norm(path.states[-1].ball_position[:2])
    assert ends["observer"] < 0.02 < 0.1 < ends["lqr"]


def test_environments_begin_on_the_ground_and_end_at_its_edges():
    ground = {"kind": "noise", "slope": 0.1, "seed": 5, "size_x": 2.0, "size_y": 2.0}
    env = gymnasium.make("ballbot/Balance-v0", terrain=ground)
    env.reset(seed=1)
    core = env.unwrapped
    state = core.state
    assert state.ball_position[2] - core.params.ball_radius == pytest.approx(
        bb.Terrain.generate("noise", seed=5, slope=0.1, size_x=2.0, size_y=2.0).height(0, 0), abs=2e-3
    )
    env.close()
    small = bb.Terrain.from_function(lambda x, _: 0.1 * x, (0.5, 0.5), 0.05)
    vec = bb.BallbotVecEnv("ballbot/Velocity-v0", num_envs=8, terrain=small, seed=2, reset_ball_speed=2.0)
    vec.reset()
    truncated = 0
    for _ in range(300):
        _, _, _, infos = vec.step(np.zeros((8, 3), dtype=np.float32))
        truncated += sum(info.get("TimeLimit.truncated", False) for info in infos if info)
    assert truncated > 0


def test_slope_limits_match_the_robot():
    limits = bb.Params.paper().slope_limits()
    assert math.degrees(limits["fall"]) == pytest.approx(15.3, abs=0.05)
    assert math.degrees(limits["traction"]) == pytest.approx(15.0, abs=0.05)
    assert limits["motor"] == pytest.approx(math.pi / 2)
    with pytest.raises(ValueError, match="fall_tilt"):
        bb.Params.paper().slope_limits(2.0)


def test_a_picture_shows_the_ground():
    """Depths of a picture from above are heights, and a slope towards the sun is brighter than a slope away from it."""
    terrain = bb.Terrain.from_function(hills, (6.0, 6.0), 0.02)
    camera = {"target": (0.0, 0.0, 0.0), "distance": 3.0, "elevation": 1.56, "azimuth": 0.0, "follows": False}
    renderer = bb.Renderer(width=64, height=48, camera=camera, terrain=terrain)
    robot = bb.Ballbot(terrain=terrain)
    robot.place_on_ground(2.9, 2.9)
    depth = renderer.depth(robot.state)
    level = bb.Renderer(width=64, height=48, camera=camera).depth(robot.state)
    assert (level - depth).max() > 0.03
    assert (level - depth).min() < -0.03
    heights = level - depth
    assert np.abs(heights).max() < 0.051
    pictures = []
    for direction in (0.8, 0.8 + math.pi):
        slope = bb.Terrain.plane(0.3, direction)
        robot = bb.Ballbot(terrain=slope)
        robot.place_on_ground(0.0, 0.0, tilt=(0.0, 0.0))
        pictures.append(bb.Renderer(terrain=slope).render(robot.state)[400:].mean())
    assert abs(pictures[0] - pictures[1]) > 5


def test_the_camera_follows_a_robot_up_and_down_a_slope():
    slope = bb.Terrain.plane(0.2)
    renderer = bb.Renderer(width=64, height=48, terrain=slope)
    robot = bb.Ballbot(terrain=slope)
    counts = []
    for x in (-5.0, 0.0, 5.0):
        robot.place_on_ground(x, 0.0)
        labels = renderer.labels(robot.state)
        counts.append([int((labels == label).sum()) for label in range(7)])
    np.testing.assert_allclose(counts[0], counts[1], atol=3)
    np.testing.assert_allclose(counts[2], counts[1], atol=3)
    assert counts[1][2] > 50


@pytest.mark.parametrize(("kind", "slope", "model", "limit"), [
    ("cobbles", 0.15, "contact", 0.003),
    ("cobbles", 0.15, "rigid", 0.005),
    ("noise", 0.2, "contact", 0.002),
    ("noise", 0.2, "rigid", 0.005),
])  # fmt: skip
def test_falls_on_rough_ground_gain_little_energy(kind, slope, model, limit):
    """A plane that is not tangent where it is touched does work on a robot that slides."""
    params = bb.Params.paper()
    terrain = bb.Terrain.generate(kind, seed=2, slope=slope)
    rng = np.random.default_rng(1)
    rises = []
    for _ in range(10):
        robot = bb.Ballbot(params, model, sim_dt=0.002, terrain=terrain)
        place, yaw, tilt = rng.uniform(-2, 2, 2), rng.uniform(-3, 3), rng.uniform(-0.3, 0.3, 2)
        robot.place_on_ground(*place, yaw=yaw, tilt=tilt)
        energies, touched = [robot.energy], False
        for _ in range(200):
            robot.step((0.0, 0.0, 0.0), 5)
            energies.append(robot.energy)
            touched |= robot.contacts.bot_on_floor
        assert touched
        rises.append(np.max(energies - np.minimum.accumulate(energies)))
    found = max(rises) / (params.body_mass * params.gravity * params.body_com_height)
    print(f"{kind}, {model}: {100 * found:.1f} % of m g l")
    assert found < limit
