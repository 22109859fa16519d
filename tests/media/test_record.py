"""Trajectories, and the videos and pictures of them."""

import itertools
import json

import numpy as np
import pytest
from PIL import Image

import ballbot_rs as bb
from ballbot_rs._core import Batch
from ballbot_rs.cli import main
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
    shown = bb.run(
        controller, seconds=4.0, tilt=(0.1, 0.0), push=bb.Push((0.3, 0.0, 0.0)), env_options={"model": model}
    )
    assert shown.fell_at is None
    tilts = shown.of_states("tilt")
    assert tilts[0] == pytest.approx(0.1)
    assert tilts[-1] < 0.01
    assert shown.times[-1] == pytest.approx(4.0)
    assert len(shown.times) == len(shown.states) == len(shown.contacts) == len(shown.torques)
    # The push shows: the tilt, nearly gone before it, grows again.
    before, after = (tilts[(shown.times > a) & (shown.times < b)] for a, b in ((0.9, 1.0), (1.0, 1.6)))
    assert after.max() > before.max()


def test_a_trajectory_is_that_of_the_environment():
    shown = bb.run("lqr", seconds=1.0, tilt=(0.1, 0.05), env_options=CONTACT)
    torque = bb.Params.paper().max_wheel_torque
    batch = Batch(1, autoreset="disabled", num_threads=1, max_wheel_torque=torque, **CONTACT)
    batch.reset(starts=[bb.State.at_rest(batch.params(), tilt=(0.1, 0.05))])
    for state, torque in zip(shown.states, shown.torques, strict=True):
        np.testing.assert_array_equal(state.to_array(), batch.states()[0])
        batch.step([torque / batch.max_wheel_torque])


def test_motors_are_off_after_a_fall():
    shown = bb.run("lqr", seconds=2.0, tilt=(0.6, 0.0), env_options=CONTACT)
    assert shown.fell_at is not None
    assert not shown.torques[shown.times >= shown.fell_at].any()
    assert shown.states[-1].tilt > 1.0
    # Without contacts there is no floor to lie on.
    shown = bb.run("zero", seconds=2.0, env_options={"model": "spatial"})
    assert shown.times[-1] == shown.fell_at


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seconds": 0.0}, "seconds = 0.0"),
        ({"seconds": float("nan")}, "seconds = nan"),
        ({"seconds": 1.0, "push": bb.Push((1.0, 0.0, 0.0), 1.0)}, "a push at 1.0 s"),
        ({"env_options": {"model": "flat"}}, "unknown model 'flat'"),
    ],
)
def test_what_cannot_happen_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.run("lqr", **arguments)


@pytest.mark.parametrize("model", ["rigid", "contact", "spatial"])
def test_a_robot_that_is_shot_away_has_fallen(model):
    shot = bb.Push((1000.0, 0.0, 0.0), 0.1)
    found = bb.run("lqr", seconds=1.0, push=shot, env_options={"model": model})
    assert found.fell_at == pytest.approx(0.1, abs=0.02)


def test_a_push_just_before_the_end_counts():
    late = bb.Push((0.5, 0.0, 0.0), 0.996)
    pushed, left_alone = (bb.run("lqr", seconds=1.0, push=push) for push in (late, None))
    assert not np.array_equal(pushed.states, left_alone.states)


def test_a_video_shows_the_robot_in_real_time(tmp_path):
    shown = bb.run("zero", seconds=0.8, tilt=(0.0, 0.2), env_options=CONTACT)
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
    shown = bb.run("lqr", seconds=0.1, env_options=CONTACT)
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
        (["--output", "a.avi"], "the name of a video ends in .mp4, that of an animation in .webp"),
        (["--size", "65", "48"], "width and height must be even"),
        (["--no-video"], "ask for a picture with --still"),
        (["--no-video", "--still", "9"], "there is no picture at 9.0 s"),
        (["--samples", "3"], "samples"),
        (["--controller", "lqrr"], "no policy at lqrr"),
    ],
)
def test_a_wrong_wish_leaves_nothing_behind(arguments, message, tmp_path, capsys, monkeypatch):
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


def test_the_robot_of_two_urdfs_is_simulated_and_shown(tmp_path, capsys, assets):
    pictures, draws = [], []
    for given in ([], ["--urdf", str(assets / "bot.urdf"), str(assets / "ball.urdf")]):
        out = tmp_path / "a.mp4"
        how = ["--size", "96", "72", "--samples", "1", "--seconds", "0.1", "--no-video", "--still", "0", "--json"]
        assert main(["record", *given, *how, "--set", "params.body_mass=3", "-o", str(out)]) == 0
        draws.append(json.loads(capsys.readouterr().out)["fell_at"])
        pictures.append(np.asarray(Image.open(out.with_suffix(".png")), dtype=int))
    assert draws == [None, None]
    assert np.abs(pictures[0] - pictures[1]).max() > 50
