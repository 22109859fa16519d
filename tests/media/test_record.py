"""Trajectories, and the videos and pictures of them."""

import itertools
import json

import numpy as np
import pytest
from PIL import Image

import ballbot_rs as bb
from ballbot_rs._core import Batch
from ballbot_rs.cli import main
from ballbot_rs.media.arrows import arrows
from ballbot_rs.media.caption import lines
from ballbot_rs.media.smoothing import smooth
from ballbot_rs.media.video import frame_count, picture, renderer_for, write_video

CONTACT = {"model": "contact"}
SMALL = {"width": 96, "height": 72, "samples": 1}


def decoded(path):
    from moviepy import VideoFileClip

    with VideoFileClip(str(path)) as clip:
        return clip.fps, clip.duration, list(clip.iter_frames())


@pytest.mark.parametrize("controller", ["lqr", "pid"])
@pytest.mark.parametrize("model", ["spatial", "contact", "rigid"])
def test_a_robot_that_was_pushed_comes_back_upright(controller, model):
    shown = bb.simulate(controller, seconds=4.0, tilt=(0.1, 0.0), pushes=bb.Push((0.3, 0.0, 0.0)), model=model)
    assert shown.fell_at is None
    tilts = shown.of_states("tilt")
    assert tilts[0] == pytest.approx(0.1)
    assert tilts[-1] < 0.01
    assert shown.times[-1] == pytest.approx(4.0)
    assert len(shown.times) == len(shown.states) == len(shown.contacts) == len(shown.torques)
    # The push shows: the tilt, nearly gone before it, grows again.
    before, after = (tilts[(shown.times > a) & (shown.times < b)] for a, b in ((0.9, 1.0), (1.0, 1.6)))
    assert after.max() > before.max()


def test_a_trajectory_matches_the_environment():
    shown = bb.simulate("lqr", seconds=1.0, tilt=(0.1, 0.05), **CONTACT)
    torque = bb.Params.paper().max_wheel_torque
    batch = Batch(1, autoreset="disabled", num_threads=1, max_wheel_torque=torque, **CONTACT)
    batch.reset(starts=[bb.State.at_rest(batch.params(), tilt=(0.1, 0.05))])
    for state, torque in zip(shown.states, shown.torques, strict=True):
        np.testing.assert_array_equal(state.to_array(), batch.states()[0])
        batch.step([torque / batch.max_wheel_torque])


def test_motors_are_off_after_a_fall():
    shown = bb.simulate("lqr", seconds=2.0, tilt=(0.6, 0.0), **CONTACT)
    assert shown.fell_at is not None
    assert not shown.torques[shown.times >= shown.fell_at].any()
    assert shown.states[-1].tilt > 1.0
    # Without contacts there is no floor to lie on.
    shown = bb.simulate("zero", seconds=2.0, model="spatial", tilt=(0.05, 0.0))
    assert shown.times[-1] == shown.fell_at


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seconds": 0.0}, "seconds = 0.0"),
        ({"seconds": float("nan")}, "seconds = nan"),
        ({"seconds": 1.0, "pushes": bb.Push((1.0, 0.0, 0.0), 1.0)}, "a push at 1.0 s"),
        ({"model": "flat"}, "unknown model 'flat'"),
    ],
)
def test_impossible_requests_are_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.simulate("lqr", **arguments)


@pytest.mark.parametrize("model", ["rigid", "contact", "spatial"])
def test_a_robot_that_is_shot_away_has_fallen(model):
    shot = bb.Push((1000.0, 0.0, 0.0), 0.1)
    found = bb.simulate("lqr", seconds=1.0, pushes=shot, model=model, tilt=(0.05, 0.0))
    assert found.fell_at == pytest.approx(0.1, abs=0.02)


def test_a_push_just_before_the_end_counts():
    late = bb.Push((0.5, 0.0, 0.0), 0.996)
    pushed, left_alone = (bb.simulate("lqr", seconds=1.0, pushes=push, tilt=(0.05, 0.0)) for push in (late, ()))
    assert not np.array_equal(pushed.states, left_alone.states)


def test_a_video_shows_the_robot_in_real_time(tmp_path):
    shown = bb.simulate("zero", seconds=0.8, tilt=(0.0, 0.2), **CONTACT)
    renderer = renderer_for(shown, **SMALL)
    path = tmp_path / "folder" / "fall.mp4"
    assert write_video(shown, path, renderer=renderer, frame_rate=25.0) == 20 == frame_count(shown, 25.0)
    rate, seconds, frames = decoded(path)
    assert rate == 25.0
    assert seconds == pytest.approx(0.8, abs=0.05)
    assert len(frames) == 20
    for i, time in ((0, 0.0), (19, 19 / 25)):
        expected = picture(shown, renderer, time).astype(int)
        assert np.abs(frames[i].astype(int) - expected).mean() < 8.0, "compression aside, the frame is the picture"
    assert np.abs(frames[0].astype(int) - frames[19]).mean() > 8.0


def test_forces_are_shown_on_request():
    shown = bb.simulate("lqr", seconds=0.1, **CONTACT, tilt=(0.05, 0.0))
    renderer = renderer_for(shown, **SMALL)
    assert (picture(shown, renderer, 0.1) != picture(shown, renderer, 0.1, forces=True)).any()
    with pytest.raises(ValueError, match=r"no picture at 0\.2 s"):
        picture(shown, renderer, 0.2)


def test_the_command_writes_a_video_and_a_picture(tmp_path, capsys):
    out = tmp_path / "lqr.mp4"
    what = ["--model", "contact", "--seconds", "0.4", "--push", "0.2", "0", "0", "--push-at", "0.1"]
    how = ["--size", "64", "48", "--samples", "1", "--forces", "--still", "--json"]
    code = main(["record", "balance", "--output", str(out), *what, *how])
    report = json.loads(capsys.readouterr().out)
    assert code == 0
    assert report == {
        "controller": "lqr",
        "model": "contact",
        "seconds": pytest.approx(0.4),
        "fell_at": None,
        "draws": {},
        "still": str(out.with_suffix(".png")),
        "frames": 20,
        "video": str(out),
    }
    assert len(decoded(out)[2]) == 20
    with Image.open(out.with_suffix(".png")) as still:
        assert still.size == (64, 48)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--output", "a.avi"], "a video ends in .mp4, an animation in .webp or .gif, frames in .png"),
        (["--size", "65", "48"], "width and height must be even"),
        (["--no-video"], "request a picture with --still"),
        (["--no-video", "--still", "9"], "there is no picture at 9.0 s"),
        (["--samples", "3"], "samples"),
        (["--controller", "lqrr"], "no policy at lqrr"),
    ],
)
def test_an_invalid_request_leaves_no_file(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["record", "--model", "planar", "--seconds", "0.2", *arguments]) == 1
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_animation_plays_in_real_time(tmp_path, capsys):
    out = tmp_path / "lqr.webp"
    how = ["--size", "97", "71", "--samples", "1", "--seconds", "1", "--frame-rate", "30", "-o", str(out), "--json"]
    assert main(["record", *how]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 30
    with Image.open(out) as animation:
        assert (animation.size, animation.n_frames, animation.info["loop"]) == ((97, 71), 30, 0)
        times = []
        for i in range(animation.n_frames):
            animation.seek(i)
            animation.load()
            times.append(animation.info["timestamp"] + animation.info["duration"])
    assert times[-1] == 1000
    assert {b - a for a, b in itertools.pairwise(times)} == {33, 34}


def still(arguments, folder):
    """The picture that the command writes, and what it prints."""
    out = folder / "a.mp4"
    how = ["--size", "96", "72", "--samples", "1", "--seconds", "0.1", "--no-video", "--json"]
    assert main(["record", *arguments, *how, "-o", str(out)]) == 0
    return np.asarray(Image.open(out.with_suffix(".png")), dtype=int)


def test_the_robot_of_two_urdfs_is_simulated_and_shown(tmp_path, assets, capsys):
    files = ["--urdf", str(assets / "bot.urdf"), str(assets / "ball.urdf"), "--set", "robot.body_mass=3"]
    plain, meshes, given = (
        still([*arguments, "--still", "0"], tmp_path) for arguments in (["--schematic"], ["--robot", "paper"], files)
    )
    assert np.abs(plain - meshes).max() > 50
    np.testing.assert_array_equal(given, meshes)
    # A published robot has the shapes of its parts, another is schematic.
    for radius, has_shapes in ((0.05, True), (0.055, False)):
        robot = ["--robot", "kugle", "--set", f"robot.wheel_radius={radius}", "--still", "0"]
        difference = np.abs(still(robot, tmp_path) - still([*robot, "--schematic"], tmp_path)).max()
        assert (difference > 50) == has_shapes
    capsys.readouterr()


def test_an_arrow_shows_a_push_where_it_acts():
    push = bb.Push((0.0, 0.3, 0.0), 0.2)
    shown = bb.simulate("lqr", seconds=1.0, tilt=(0.0, 0.0), pushes=push, **CONTACT)
    rows = [round(time / 0.01) for time in (0.1, 0.2, 0.5, 0.7)]
    before, during, after, long_after = (arrows(shown, row) for row in rows)
    assert len(before) == len(long_after) == 0
    assert len(during) == len(after) == 1
    tail, tip = during[0]
    com = shown.states[20].body_position + np.array([0.0, 0.0, shown.params.body_com_height])
    radius = shown.params.ball_radius
    np.testing.assert_allclose(tip, com - [0.0, radius, 0.0], atol=1e-3)
    np.testing.assert_allclose(tip - tail, [0.0, 3.0 * radius, 0.0], atol=1e-12)
    assert lines(shown, 20) == ["LQR on contact", "0.20 s   tilt 0.0°", "push 0.3 N·s"]
    assert len(lines(shown, 10)) == 2


def test_arrows_of_two_pushes_are_as_long_as_their_impulses():
    pushes = (bb.Push((0.2, 0.0, 0.0), 0.1), bb.Push((0.1, 0.0, 0.0), 0.1, point=(0.0, 0.0, 0.3)))
    shown = bb.simulate("lqr", seconds=0.3, pushes=pushes, forces=(bb.Force((0.0, 1.0, 0.0), 0.2, 0.25),))
    lengths = np.linalg.norm(np.diff(arrows(shown, 15), axis=1)[:, 0], axis=1)
    assert lengths[0] == pytest.approx(2.0 * lengths[1])
    assert lines(shown, 15)[2] == "push 0.2 N·s, push 0.1 N·s"
    assert lines(shown, 22)[2] == "push 0.2 N·s, push 0.1 N·s, force 1 N"
    assert len(arrows(shown, 22)) == 3


def test_the_command_of_the_task_is_shown():
    going = bb.simulate("lqr", seconds=3.0, task="velocity", seed=1)
    row = int(np.abs(going.commands[:, 0]).argmax())
    ((tail, tip),) = arrows(going, row)
    x, y, _ = going.commands[row]
    yaw = going.states[row].yaw
    desired = [x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) + y * np.cos(yaw)]
    np.testing.assert_allclose((tip - tail)[:2], desired, atol=1e-12)
    to_goal = bb.simulate("lqr", seconds=0.1, task="goal", seed=1)
    mark, way = arrows(to_goal, 0)
    np.testing.assert_allclose(mark[1][:2], to_goal.commands[0])
    np.testing.assert_allclose(way[1][:2], to_goal.commands[0])
    path = arrows(bb.simulate("lqr", seconds=0.1, task="path", seed=1), 0)
    np.testing.assert_allclose(path[:, 1], np.roll(path[:, 0], -1, axis=0))
    np.testing.assert_allclose(path[0, 0, :2], 0.0, atol=1e-12)


def test_a_caption_states_when_the_robot_fell():
    shown = bb.simulate("zero", seconds=1.5, tilt=(0.3, 0.0), **CONTACT)
    assert shown.fell_at is not None
    assert lines(shown, len(shown.times) - 1)[2] == f"fell at {shown.fell_at:.2f} s"
    renderer = renderer_for(shown, **SMALL)
    plain, captioned = (picture(shown, renderer, 0.1, caption=given, smooth=False) for given in (False, True))
    changed = (plain != captioned).any(axis=2)
    assert changed[:45].any()
    assert not changed[45:].any(), "the caption is in the corner"
    np.testing.assert_array_equal(plain, renderer.render(shown.states[10]))


def test_edges_are_blended_and_nothing_else():
    flat = np.full((20, 20, 3), 90, dtype=np.uint8)
    np.testing.assert_array_equal(smooth(flat), flat)
    tiny = np.zeros((2, 2, 3), dtype=np.uint8)
    np.testing.assert_array_equal(smooth(tiny), tiny)
    # A shallow edge, with one and with many samples for each pixel.
    fine = np.add.outer(np.arange(0, 20, 0.125), -0.2 * np.arange(0, 40, 0.125)) > 6.0
    exact = 40.0 + 180.0 * fine.reshape(20, 8, 40, 8).mean(axis=(1, 3))
    stairs = np.repeat(np.uint8(40 + 180 * fine[4::8, 4::8])[..., np.newaxis], 3, axis=2)
    blended = smooth(stairs)[..., 0].astype(float)
    error, before = (np.sqrt(((values - exact) ** 2).mean()) for values in (blended, stairs[..., 0].astype(float)))
    assert error < 0.8 * before
    assert blended.min() >= 40
    assert blended.max() <= 220


def test_controllers_are_shown_side_by_side(tmp_path, capsys):
    out = tmp_path / "both.mp4"
    who = ["--controller", "lqr", "--controller", "zero", "--model", "spatial", "--tilt", "0.2", "0"]
    how = ["--size", "64", "48", "--seconds", "1.2", "--frame-rate", "10", "--still", "0.3", "--json"]
    assert main(["record", *who, *how, "-o", str(out)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [one["controller"] for one in report["shown"]] == ["lqr", "zero"]
    standing, fallen = report["shown"]
    assert standing["fell_at"] is None
    assert fallen["seconds"] == fallen["fell_at"] < 1.0, "without a floor the video of a fallen robot does not move"
    frames = decoded(out)[2]
    assert len(frames) == report["frames"] == 12
    assert frames[0].shape == (48, 128, 3)
    left, right = (np.abs(np.diff(np.array(frames[-2:], dtype=int)[:, 20:, part], axis=0)).max() for part in HALVES)
    assert right < left
    with Image.open(out.with_suffix(".png")) as taken:
        assert taken.size == (128, 48)


HALVES = (slice(0, 62), slice(66, 128))


def test_one_image_for_each_robot_needs_one_renderer_for_each(tmp_path):
    shown = bb.simulate("lqr", seconds=0.1, **CONTACT, tilt=(0.05, 0.0))
    one, low = renderer_for(shown, **SMALL), renderer_for(shown, **{**SMALL, "height": 48})
    for renderers, message in (
        ([one], "1 renderers for 2 trajectories"),
        ([one, low], "the same height"),
    ):
        with pytest.raises(ValueError, match=message):
            write_video([shown, shown], tmp_path / "a.mp4", renderer=renderers)
    with pytest.raises(ValueError, match="at least one trajectory"):
        write_video([], tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_the_picture_of_a_push_is_after_it(tmp_path):
    push = ["--push", "0.3", "0", "0", "--push-at", "0.05"]
    pictures = [still([*push, "--still", *time], tmp_path) for time in ([], ["0"])]
    assert np.abs(pictures[0] - pictures[1]).max() > 50


def test_pushes_of_the_task_are_in_the_picture_and_its_caption():
    shown = bb.simulate("lqr", task="push", seconds=6.0, seed=1)
    (push, *_) = shown.drawn_pushes
    row = round(push.time / 0.01) + 10
    assert lines(shown, row)[2] == f"push {np.linalg.norm(push.impulse):.3g} N·s"
    (arrow, *_) = arrows(shown, row)
    way = arrow[1] - arrow[0]
    np.testing.assert_allclose(way / np.linalg.norm(way), np.array(push.impulse) / np.linalg.norm(push.impulse))
    assert len(lines(shown, row - 20)) == 2
