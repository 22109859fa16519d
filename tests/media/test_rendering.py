"""Frames: what is in them, and the contracts of their callers."""

import copy
import multiprocessing
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import HumanRendering, RecordVideo

import ballbot_rs as bb
from ballbot_rs._core import LABELS

ROOT = Path(__file__).parents[2]
GOLDEN = Path(__file__).with_name("golden_frames.npz")
SMALL = {"width": 96, "height": 72}
PARAMS = bb.Params.paper()
UPRIGHT = bb.State.at_rest(PARAMS)
LEANING = bb.State.at_rest(PARAMS, tilt=(0.1, 0.25), yaw=0.4)

#: Name of each golden frame and how it is made.
FRAMES = {
    "upright": lambda: bb.Renderer(**SMALL).render(UPRIGHT),
    "leaning": lambda: bb.Renderer(**SMALL, samples=4).render(LEANING, arrows=[[[0.4, 0.0, 0.5], [0.2, 0.0, 0.5]]]),
    "kugle": lambda: bb.Renderer("kugle", **SMALL, samples=2).render(bb.State.at_rest(bb.Params.preset("kugle"))),
    "urdf": lambda: bb.Renderer(urdf=(ROOT / "assets/bot.urdf", ROOT / "assets/ball.urdf"), **SMALL).render(LEANING),
}


@pytest.mark.parametrize("name", FRAMES)
def test_frames_look_as_they_did(name):
    """`python tests/media/test_rendering.py` keeps new frames, to be inspected and committed."""
    golden = np.load(GOLDEN)[name].astype(int)
    off = np.abs(FRAMES[name]().astype(int) - golden).max(axis=2)
    # Rounding may decide about a ray along an edge.
    assert (off > 8).mean() < 0.005


def test_a_frame_of_a_leaning_robot_differs_where_the_robot_is():
    renderer = bb.Renderer(**SMALL)
    changed = np.any(renderer.render(UPRIGHT) != renderer.render(LEANING), axis=2)
    robot = (renderer.labels(UPRIGHT) > LABELS.index("floor")) | (renderer.labels(LEANING) > LABELS.index("floor"))
    assert changed[robot].mean() > 0.3
    # What else changes is the shadow.
    assert 0.01 < changed[~robot].mean() < 0.3


def test_shadows_fade_smoothly_and_lit_floor_is_uniform():
    """In a white square of the floor: the edge of a shadow, and far from it."""

    def floor(x, y):
        camera = {"target": (x, y, 0.0), "distance": 0.1, "azimuth": 0.7, "elevation": 1.5, "follows": False}
        return bb.Renderer(width=200, height=200, camera=camera).render(UPRIGHT)[..., 1].astype(int)

    edge = floor(0.3, 0.33)
    assert np.ptp(edge) > 20
    # Steps of a few shadow rays would be larger.
    assert max(np.abs(np.diff(edge, axis=axis)).max() for axis in (0, 1)) <= 6
    assert np.ptp(floor(0.375, 0.875)) <= 1


def test_depth_and_labels_agree():
    renderer = bb.Renderer(**SMALL)
    depth, labels = renderer.depth(UPRIGHT), renderer.labels(UPRIGHT)
    assert depth.dtype == np.float32
    assert labels.dtype == np.uint8
    assert depth.shape == labels.shape == (72, 96)
    assert set(np.unique(labels)) <= set(range(len(LABELS)))
    assert np.isinf(depth[labels == LABELS.index("sky")]).all()
    ball, floor = (depth[labels == LABELS.index(name)] for name in ("ball", "floor"))
    assert floor.min() < ball.min() < ball.max() < floor[np.isfinite(floor)].max()


def test_forces_are_drawn_as_arrows():
    robot = bb.Ballbot(model="contact")
    robot.step([0.1, 0.1, 0.1], steps=10)
    renderer = bb.Renderer(**SMALL)
    plain, with_forces = renderer.render(robot.state), renderer.render(robot.state, robot.contacts)
    assert np.any(plain != with_forces, axis=2).sum() > 5


def test_a_batch_is_its_single_frames():
    renderer = bb.Renderer(**SMALL)
    frames = renderer.render_batch([UPRIGHT.to_array(), LEANING.to_array()])
    assert frames.shape == (2, 72, 96, 3)
    np.testing.assert_array_equal(frames[0], renderer.render(UPRIGHT))
    np.testing.assert_array_equal(frames[1], renderer.render(LEANING))
    assert renderer.render_batch(np.empty((0, 32))).shape == (0, 72, 96, 3)


def test_the_camera_follows_the_ball_or_stays_fixed():
    away = UPRIGHT.replace(ball_position=[3.0, 0.0, PARAMS.ball_radius], body_position=[3.0, 0.0, PARAMS.ball_radius])
    following = bb.Renderer(**SMALL)
    standing = bb.Renderer(**SMALL, camera={"follows": False})
    assert (following.labels(away) == following.labels(UPRIGHT)).all()
    assert (standing.labels(away) == LABELS.index("ball")).sum() < (standing.labels(UPRIGHT) == 2).sum()


@pytest.mark.parametrize(
    ("arguments", "error", "match"),
    [
        ({"width": 0}, ValueError, "width"),
        ({"height": -3}, ValueError, "height = -3"),
        ({"width": 10_000}, ValueError, "8192"),
        ({"samples": 3}, ValueError, "samples"),
        ({"num_threads": 0}, ValueError, "num_threads"),
        ({"camera": {"elevation": -0.5}}, ValueError, "camera height"),
        ({"camera": {"zoom": 2.0}}, TypeError, "unknown camera setting 'zoom'"),
        ({"camera": {"distance": float("nan")}}, ValueError, "distance"),
        ({"camera": {"elevation": 2.0}}, ValueError, "elevation"),
        ({"robot": "kugel"}, ValueError, "kugel"),
        ({"urdf": ("nothing.urdf", "ball.urdf")}, OSError, r"nothing\.urdf"),
    ],
)
def test_invalid_renderers_are_rejected(arguments, error, match):
    with pytest.raises(error, match=match):
        bb.Renderer(**arguments)


def test_invalid_input_of_the_renderer_is_rejected():
    renderer = bb.Renderer(**SMALL)
    with pytest.raises(ValueError, match="arrows"):
        renderer.render(UPRIGHT, arrows=[[0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match="arrow"):
        renderer.render(UPRIGHT, arrows=[[[0.0, 0.0, np.nan], [0.0, 0.0, 1.0]]])
    with pytest.raises(ValueError, match="quaternion"):
        renderer.render_batch(np.zeros((1, 32)))


def env(**options):
    return gymnasium.make("ballbot/Balance-v0", render_mode="rgb_array", render_options=SMALL, **options)


def test_render_of_an_environment():
    made = env()
    made.reset(seed=0, options={"state": LEANING})
    assert made.unwrapped.render_mode == "rgb_array"
    frame = made.render()
    np.testing.assert_array_equal(frame, bb.Renderer(**SMALL).render(LEANING))
    made.step(np.zeros(3, dtype=np.float32))
    assert np.any(made.render() != frame)


def test_render_without_a_mode_warns_and_shows_nothing():
    made = bb.BalanceEnv()
    made.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert made.render() is None


def test_an_unknown_mode_is_rejected():
    for make in (bb.BalanceEnv, bb.BalanceVectorEnv):
        with pytest.raises(ValueError, match="render_mode = 'ansi'"):
            make(render_mode="ansi")


def test_render_options_are_checked_when_an_environment_is_made():
    with pytest.raises(TypeError, match="widht"):
        bb.BalanceEnv(render_options={"widht": 3})
    shipped = (ROOT / "assets/bot.urdf", ROOT / "assets/ball.urdf")
    bb.BalanceEnv(render_mode="rgb_array", render_options={"urdf": shipped, **SMALL})
    with pytest.raises(ValueError, match="ball_radius"):
        bb.BalanceEnv(robot="kugle", max_wheel_torque=1.0, render_mode="rgb_array", render_options={"urdf": shipped})


def test_images_larger_than_memory_are_rejected():
    renderer = bb.Renderer(width=8192, height=8192)
    states = np.broadcast_to(UPRIGHT.to_array(), (100_000, 32))
    with pytest.raises(MemoryError, match="picture"):
        renderer.render_batch(states)


def frame_elsewhere(env, connection):
    connection.send(env.render())
    connection.close()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_child_process_renders_what_its_parent_has_rendered():
    """Threads do not survive a fork: waiting for threads of the parent would never end."""
    made = bb.BalanceEnv(render_mode="rgb_array", render_options=SMALL | {"num_threads": 2})
    made.reset(seed=0)
    frame = made.render()
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=frame_elsewhere, args=(made, sender))
    process.start()
    sender.close()
    try:
        assert receiver.poll(30), "the child process hangs"
        np.testing.assert_array_equal(receiver.recv(), frame)
    finally:
        process.kill()
        process.join()


def test_copies_show_the_same():
    made = bb.BalanceEnv(render_mode="rgb_array", render_options=SMALL)
    made.reset(seed=3)
    for twin in (copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
        np.testing.assert_array_equal(twin.render(), made.render())


def test_a_vector_environment_gives_a_frame_for_each():
    envs = gymnasium.make_vec("ballbot/Balance-v0", num_envs=3, render_mode="rgb_array", render_options=SMALL)
    envs.reset(seed=0)
    frames = envs.render()
    assert len(frames) == 3
    assert frames[0].shape == (72, 96, 3)
    assert np.any(frames[0] != frames[1])


def test_record_video_of_gymnasium(tmp_path):
    made = RecordVideo(env(), str(tmp_path), disable_logger=True)
    made.reset(seed=0)
    for _ in range(20):
        made.step(np.zeros(3, dtype=np.float32))
    made.close()
    frames = read_video(tmp_path)
    assert len(frames) in (20, 21)
    first = bb.Renderer(**SMALL).labels(UPRIGHT)
    # The floor is light, the ball is not.
    assert frames[0][first == LABELS.index("floor")].mean() > 150 > frames[0][first == LABELS.index("body")].min()


def test_human_rendering_of_gymnasium(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    made = gymnasium.make("ballbot/Balance-v0", render_mode="human", render_options=SMALL)
    assert isinstance(made, HumanRendering)
    made.reset(seed=0)
    made.step(np.zeros(3, dtype=np.float32))
    shown = made.window
    assert shown.get_size() == (96, 72)
    made.close()


def test_images_of_stable_baselines():
    pytest.importorskip("stable_baselines3")
    made = bb.BallbotVecEnv(num_envs=4, seed=0, render_mode="rgb_array", render_options=SMALL)
    made.reset()
    images = made.get_images()
    assert [image.shape for image in images] == [(72, 96, 3)] * 4
    assert made.render().shape == (144, 192, 3)
    assert made.get_attr("render_mode") == ["rgb_array"] * 4


def test_video_recorder_of_stable_baselines(tmp_path):
    recorder = pytest.importorskip("stable_baselines3.common.vec_env").VecVideoRecorder
    made = bb.BallbotVecEnv(num_envs=2, seed=0, render_mode="rgb_array", render_options=SMALL)
    made = recorder(made, str(tmp_path), record_video_trigger=lambda step: step == 0, video_length=15)
    made.reset()
    for _ in range(20):
        made.step(np.zeros((2, 3), dtype=np.float32))
    made.close()
    assert len(read_video(tmp_path)) in (15, 16)


def read_video(folder):
    from moviepy import VideoFileClip

    (path,) = folder.glob("*.mp4")
    with VideoFileClip(str(path)) as clip:
        return list(clip.iter_frames())


if __name__ == "__main__":
    np.savez_compressed(GOLDEN, **{name: make() for name, make in FRAMES.items()})
