"""Instruments from Python."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_with_sb3

import ballbot_rs as bb
from ballbot_rs._core import INSTRUMENTS
from ballbot_rs.control.resolve import find
from ballbot_rs.envs.spaces import observation_space
from ballbot_rs.viewer.session import Session

#: Small instruments.
SCAN = {"points": (5, 3), "spacing": 0.1}
DEPTH = {"size": (6, 4)}
LIDAR = {"beams": 8}
HILLS = {"kind": "noise", "seed": 3, "slope": 0.15, "cell": 0.05}


def velocity_env(**options):
    """A robot on hills with all instruments."""
    return bb.VelocityEnv(**{"terrain": HILLS, "scan": SCAN, "depth": DEPTH, "lidar": LIDAR, **options})


def test_readings_follow_the_rows_of_the_task():
    env = velocity_env(scale_observations=False)
    rows = len(bb._core.TASKS["velocity"]["observation"])
    assert env.observation_layout == {"state": (rows,), "scan": (3, 5), "depth": (4, 6), "lidar": (8,)}
    assert env.observation_space.shape == (rows + 15 + 24 + 8,)
    observation, _ = env.reset(seed=1)
    assert observation in env.observation_space
    np.testing.assert_array_equal(observation[rows : rows + 15], env.perceived("scan").ravel())
    np.testing.assert_array_equal(observation[rows + 15 : rows + 39], env.perceived("depth").ravel())
    np.testing.assert_array_equal(observation[rows + 39 :], env.perceived("lidar"))
    assert env.perceived("scan").dtype == env.perceived("depth").dtype == np.float32
    # A scan agrees with the terrain.
    state, terrain = env.state, env._batch.terrain
    ball = np.array(state.ball_position)
    expected = ball[2] - env.params.ball_radius - terrain.height(ball[0], ball[1])
    assert env.perceived("scan")[1, 2] == pytest.approx(expected, abs=1e-6)


def test_scaled_readings_are_within_the_space():
    env = velocity_env()
    observation, _ = env.reset(seed=1)
    groups = bb.GroupedObservations(env)
    parts, _ = groups.reset(seed=1)
    assert parts in groups.observation_space
    np.testing.assert_allclose(parts["scan"], env.perceived("scan") / 0.1, rtol=1e-6)
    np.testing.assert_allclose(parts["depth"], env.perceived("depth") / 3.0, rtol=1e-6)
    np.testing.assert_allclose(parts["lidar"], env.perceived("lidar") / 5.0, rtol=1e-6)
    np.testing.assert_array_equal(np.concatenate([part.ravel() for part in parts.values()]), observation)
    for _ in range(30):
        observation = env.step(env.action_space.sample())[0]
        assert observation in env.observation_space


@pytest.mark.parametrize("terrain", [None, HILLS])
def test_a_depth_image_matches_the_renderer(terrain):
    pitch, view, size = 0.5, 1.1, (32, 24)
    # Ahead of the robot, which the renderer shows.
    position = (0.8, 0.0, 0.5)
    depth = {"size": size, "position": position, "pitch": pitch, "field_of_view": view, "rate": 0, "far": 4.0}
    env = bb.BalanceEnv(depth=depth, terrain=terrain)
    robot = bb.Ballbot(env.params, terrain=terrain)
    # Upright: the renderer's camera does not roll.
    robot.place_on_ground(0.3, -0.4, yaw=0.0, tilt=(0.0, 0.0))
    env.reset(seed=0, options={"state": robot.state})
    eye = np.array(env.state.ball_position) + position
    axis = np.array((np.cos(pitch), 0.0, -np.sin(pitch)))
    renderer = bb.Renderer(
        width=size[0],
        height=size[1],
        terrain=terrain,
        camera={
            "target": eye + axis,
            "distance": 1.0,
            "azimuth": float(np.arctan2(-axis[1], -axis[0])),
            "elevation": float(np.arcsin(-axis[2])),
            "field_of_view": view,
            "follows": False,
        },
    )
    np.testing.assert_allclose(env.perceived("depth"), np.minimum(renderer.depth(env.state), 4.0), atol=1e-5)


@pytest.mark.parametrize("wrap", [lambda env: env, bb.GroupedObservations])
def test_gymnasium_accepts_the_environment(wrap):
    check_env(wrap(velocity_env()), skip_render_check=True)


def test_sb3_learns_from_flat_and_grouped_observations():
    check_with_sb3(velocity_env())
    flat = bb.BallbotVecEnv(4, task="velocity", terrain=HILLS, scan=SCAN, seed=0)
    PPO("MlpPolicy", flat, n_steps=16, batch_size=32, n_epochs=1, device="cpu").learn(64)
    grouped = bb.GroupedVecEnv(
        bb.BallbotVecEnv(4, task="velocity", terrain=HILLS, scan=SCAN, seed=0, max_episode_steps=9)
    )
    model = PPO("MultiInputPolicy", grouped, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    model.learn(64)
    grouped.reset()
    for _ in range(9):
        _, _, done, infos = grouped.step(np.zeros((4, 3), dtype=np.float32))
    assert done.all()
    assert infos[0]["terminal_observation"]["scan"].shape == (3, 5)


def test_vector_environments_group_too():
    env = bb.GroupedVectorObservations(bb.VelocityVectorEnv(3, terrain=HILLS, scan=SCAN))
    observations, _ = env.reset(seed=0)
    assert observations["scan"].shape == (3, 3, 5)
    assert observations in env.observation_space
    assert env.step(env.action_space.sample())[0]["state"].shape[0] == 3


def test_policies_keep_their_instruments(tmp_path):
    env = bb.BallbotVecEnv(4, task="velocity", scan=SCAN, seed=0)
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    file = bb.save(model, tmp_path / "policy")
    assert find(str(file)).env_options["scan"]["points"] == [5.0, 3.0]
    session = Session(controller=find(str(file)), task="velocity")
    session.advance(0.1)
    assert session.robots.observations.shape == (1, env.observation_space.shape[0])
    assert bb.evaluate(file, episodes=2, max_episode_steps=20).episodes == 2


def test_copies_and_pickles_continue_with_the_same_readings():
    env = velocity_env(scan={**SCAN, "latency": 0.05, "noise": 0.01, "dropout": 0.1})
    env.reset(seed=4)
    for _ in range(7):
        env.step(np.zeros(3))
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for _ in range(20):
        expected = env.step(np.full(3, 0.02))[0]
        for twin in twins:
            np.testing.assert_array_equal(twin.step(np.full(3, 0.02))[0], expected)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scan": {"points": (0, 5)}}, r"scan.points\[0\] = 0"),
        ({"scan": {"nose": 1}}, "unknown option of scan 'nose'"),
        ({"scan": {"latency": 0.013}}, "scan.latency / control_dt"),
        ({"depth": {"position": (0.0, 0.0, 0.05)}}, "outside of the ball"),
        ({"lidar": {"position": (0.0, 0.0, 0.05)}}, "outside of the ball"),
        ({"lidar": {"beams": 8.5}}, "lidar.beams = 8.5"),
        ({"lidar": {"max_range": 0.01}}, "lidar.min_range = 0.05"),
        ({"level": 2}, "the terrain has none"),
        ({"level": -1}, "level = -1"),
        ({"level": "hard"}, "level = 'hard'"),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        bb.VelocityEnv(**options)


@pytest.mark.parametrize("options", [{"scan": 3}, {"depth": "big"}, {"lidar": True}, {"level": 1.5}])
def test_options_of_a_wrong_type_are_named(options):
    with pytest.raises(TypeError, match=next(iter(options))):
        bb.VelocityEnv(**options)


def test_robots_without_instruments_raise():
    env = bb.BalanceEnv()
    for name in INSTRUMENTS:
        with pytest.raises(ValueError, match=f"the robots have no {name}"):
            env.perceived(name)
    with pytest.raises(ValueError, match="did you mean 'scan'"):
        env.perceived("scam")
    assert env.observation_layout == {"state": env.observation_space.shape}


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_every_instrument_is_in_every_front_end(name):
    env = bb.BalanceEnv(**{name: {}})
    observation, _ = env.reset(seed=2)
    shape = env.observation_layout[name]
    assert env.perceived(name).shape == shape
    assert observation in env.observation_space
    assert observation_space("balance", {name: {}}) == env.observation_space
    assert set(env.task_options[name]) == {option["name"] for option in INSTRUMENTS[name]["options"]}
    for envs in (bb.BalanceVectorEnv(3, **{name: {}}), bb.BallbotVecEnv(3, **{name: {}})):
        envs.reset()
        assert envs.perceived(name).shape == (3, *shape)
        assert envs.observation_layout[name] == shape


@pytest.mark.parametrize("far", [2.7, 3.0, 4.9, 0.3])
def test_scaled_readings_of_nothing_are_within_the_space(far):
    for name, options in {
        "depth": {"far": far, "pitch": -0.5},
        "lidar": {"max_range": far, "depression": -0.5},
    }.items():
        env = bb.BalanceEnv(**{name: options})
        assert env.reset(seed=0)[0] in env.observation_space


@pytest.mark.parametrize(("slope", "depression"), [(0.0, 0.3), (0.15, 0.5)])
def test_lidar_on_planes_is_exact_for_each_beam(slope, depression):
    terrain = {"kind": "plane", "slope": slope} if slope else None
    lidar = {"beams": 16, "stabilized": 1, "depression": depression, "max_range": 50}
    env = bb.BalanceEnv(terrain=terrain, lidar=lidar)
    env.reset(seed=3)
    w, x, y, z = env.state.body_quaternion
    mast = np.array((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
    eye = env.state.ball_position + 0.4 * mast
    angles = 2 * np.arctan2(z, w) + ((np.arange(16) + 0.5) / 16 - 0.5) * 2 * np.pi
    beams = np.stack((np.cos(angles), np.sin(angles), np.full(16, -np.tan(depression))), 1) * np.cos(depression)
    rise = env._batch.terrain.height(1.0, 0.0) if terrain else 0.0
    closing = rise * beams[:, 0] - beams[:, 2]
    height = eye[2] - rise * eye[0]
    expected = np.where(closing > 0, height / np.where(closing > 0, closing, 1.0), np.inf)
    np.testing.assert_allclose(env.perceived("lidar"), np.minimum(expected, 50), rtol=1e-5)


def test_levels_of_the_terrain_task():
    envs = bb.TerrainVectorEnv(64, seed=0)
    envs.reset(seed=0)
    assert set(envs.levels()) == {0, 1, 2, 3, 4}
    hard = bb.TerrainVectorEnv(8, level=4)
    hard.reset(seed=0)
    assert (hard.levels() == 4).all()
    climbing = bb.TerrainVectorEnv(8, level="curriculum")
    climbing.reset(seed=0)
    assert (climbing.levels() == 0).all()
    assert gymnasium.make("ballbot/Terrain-v0", level=2).reset(seed=0)[0].shape == hard.single_observation_space.shape
