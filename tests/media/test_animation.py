"""GIF, numbered pictures, and the video in the output of a notebook: the same frames, in real time."""

import base64
import re

import numpy as np
import pytest
from PIL import Image

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.media.video import picture, renderer_for

SMALL = {"width": 96, "height": 72, "samples": 1}


@pytest.fixture(scope="module")
def shown():
    return bb.simulate("lqr", seconds=0.4, tilt=(0.1, 0.0), model="spatial")


def test_pictures_are_the_frames_with_their_numbers(shown, tmp_path):
    renderer = renderer_for(shown, **SMALL)
    assert shown.record(tmp_path / "frames" / "a-%03d.png", renderer=renderer, frame_rate=10.0) == 4
    files = sorted((tmp_path / "frames").iterdir())
    assert [file.name for file in files] == [f"a-{i:03}.png" for i in range(4)]
    for i, file in enumerate(files):
        with Image.open(file) as frame:
            np.testing.assert_array_equal(np.asarray(frame), picture(shown, renderer, 0.1 * i))


@pytest.mark.parametrize("frame_rate", [50.0, 30.0, 7.0])
def test_a_gif_plays_in_real_time_and_repeats(shown, tmp_path, frame_rate):
    out = tmp_path / "a.gif"
    count = shown.record(out, renderer=renderer_for(shown, **SMALL), frame_rate=frame_rate)
    with Image.open(out) as gif:
        assert gif.size == (96, 72)
        assert gif.info["loop"] == 0
        times = []
        for i in range(gif.n_frames):
            gif.seek(i)
            times.append(gif.info["duration"])
    assert sum(times) == pytest.approx(1000.0 * count / frame_rate, abs=5.0)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.gif", {"frame_rate": 60.0}, "frame_rate = 60 is out of range for a GIF: it must be at most 50"),
        ("a.png", {}, r"frames have numbers in their names, as a-%04d\.png"),
        ("a-%s.png", {}, "frames have numbers in their names"),
        ("a-%d-%d.png", {}, "frames have numbers in their names"),
        ("a.avi", {}, r"a video ends in \.mp4, an animation in \.webp or \.gif"),
    ],
)
def test_other_names_and_rates_are_rejected_before_the_first_frame(shown, tmp_path, name, options, message):
    with pytest.raises(ValueError, match=message):
        shown.record(tmp_path / name, progress=lambda *_: pytest.fail("a frame was rendered"), **options)
    assert not list(tmp_path.iterdir())


def test_the_command_writes_them_too(capsys, tmp_path):
    few = ["record", "--seconds", "0.1", "--frame-rate", "20", "--size", "96", "72"]
    main([*few, "-o", str(tmp_path / "%02d.png")])
    main([*few, "-o", str(tmp_path / "a.gif")])
    assert {path.name for path in tmp_path.iterdir()} == {"00.png", "01.png", "a.gif"}
    capsys.readouterr()
    assert main([*few, "-o", str(tmp_path / "%02d.png"), "--still"]) == 1
    assert "are pictures of all frames: leave out --still" in capsys.readouterr().err


def test_a_notebook_shows_a_video(shown, tmp_path):
    options = {"frame_rate": 20.0, "renderer": renderer_for(shown, **SMALL)}
    shown.record(tmp_path / "a.mp4", **options)
    animation = shown.animate(**options)
    text = animation._repr_html_()
    (data,) = re.findall(r'^<video controls [^>]*src="data:video/mp4;base64,([^"]+)"></video>$', text)
    assert base64.b64decode(data) == (tmp_path / "a.mp4").read_bytes()
    assert "lqr on spatial, 0.40 s, upright to the end" in text
    assert repr(animation).startswith("<Animation of lqr on spatial, 0.40 s, upright to the end: ")
