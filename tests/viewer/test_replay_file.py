"""`Trajectory.to_html`: one file whose robot is where the trajectory has it, at its time."""

import base64
import dataclasses
import html
import re
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

pytest.importorskip("viser", reason="replays are not tested: install 'ballbot-rs[view]'")

import msgspec
import zstandard

import ballbot_rs as bb
from ballbot_rs.viewer.replay.frames import rows_at
from ballbot_rs.viewer.replay.recorder import REST, record
from ballbot_rs.viewer.scene.ground import DARK, LIGHT
from tests.support.chromium import Chromium, find_browser
from tests.support.waiting import wait_until

PUSH = bb.Push((0.3, 0.1, 0.0), time=0.4)
OWN = bb.Params.preset("kugle").replace(ball_radius=0.2)
CONFIG = "__VISER_EMBED_CONFIG__={darkMode:%s}"


@pytest.fixture(scope="module")
def done():
    return bb.simulate("lqr", tilt=(0.05, -0.02), pushes=PUSH, seconds=1.0)


def document_of(path):
    [document] = re.findall('srcdoc="([^"]*)"', path.read_text(encoding="utf-8"))
    return html.unescape(document)


class Replayed:
    """What viser's player would show: the messages of a document up to a time."""

    def __init__(self, document):
        [data] = re.findall(r'__VISER_EMBED_DATA__="([^"]*)"', document)
        content = zstandard.ZstdDecompressor().decompress(base64.b64decode(data)[8:])
        found = msgspec.msgpack.decode(content[8 : 8 + int.from_bytes(content[:8], "little")])
        self.seconds, self.messages = found["durationSeconds"], found["messages"]

    def at(self, seconds):
        """Positions, attitudes and visibilities of nodes by name, and the posted source."""
        state = {}
        for moment, message in self.messages:
            if moment > seconds + 1e-9:
                break
            state.update({(message.get("name"), part): value for part, value in message.items()})
        return state


def check(document, trajectory, rows):
    """Compares ball, body and wheels with rows of the trajectory."""
    replayed = Replayed(document)
    for row in rows:
        moment, state = trajectory.times[row], trajectory.states[row]
        shown = replayed.at(moment - trajectory.times[0])
        [root] = {name[: -len("/ball")] for name, _ in shown if name is not None and name.endswith("/ball")}
        # viser leaves out changes below 1e-5 of a number.
        close = {"rtol": 2e-5, "atol": 2e-7}
        for part in ("ball", "body"):
            position, attitude = (getattr(state, f"{part}_{kind}") for kind in ("position", "quaternion"))
            np.testing.assert_allclose(shown[f"{root}/{part}", "position"], position, **close)
            np.testing.assert_allclose(shown.get((f"{root}/{part}", "wxyz"), (1, 0, 0, 0)), attitude, **close)
        turned = [shown.get((f"{root}/body/wheel_{i}/turned", "wxyz"), (1,))[0] for i in range(3)]
        np.testing.assert_allclose(turned, np.cos(0.5 * state.wheel_angles), **close)
        # The world moves, so that the ball stays in the middle.
        if trajectory.terrain is None:
            world = shown.get(("/world", "position"), np.zeros(3))
            np.testing.assert_allclose(np.add(world, state.ball_position)[:2], 0.0, atol=1e-4)
        assert shown[None, "source"] == f"parent.postMessage({moment:.6g}, '*')"
    return replayed


def test_the_robot_is_where_the_trajectory_has_it_at_its_time(done):
    rows = rows_at(done.times, 60.0)
    replayed = check(record(done), done, [*rows[::9], rows[-1]])
    assert replayed.seconds == pytest.approx(1.0 + REST)
    arrow = "/world/loads", "visible"
    assert [replayed.at(t)[arrow] for t in (0.0, PUSH.time - 0.05, PUSH.time + 0.05)] == [False, False, True]
    assert replayed.at(1.0)[arrow] is False


def test_a_replay_shows_payloads_and_obstacles():
    robot = bb.Params.paper().with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=90.0)
    post = bb.Terrain.plane(0.0).with_obstacles([{"kind": "post", "x": 0.5}])
    done = bb.simulate("lqr", robot=robot, terrain=post, tilt=(0.05, -0.02), seconds=0.4)
    replayed = check(record(done), done, [0])
    for row in (0, 20, 40):
        shown = replayed.at(done.times[row])
        [name] = {name for name, _ in shown if name is not None and "payload" in name}
        place = np.add(robot.payload_position, done.payloads[row, 0, :3])
        np.testing.assert_allclose(shown[name, "position"], place, rtol=2e-5, atol=2e-7)
        assert name.endswith("/body/payload_0")
        assert any(name is not None and name.endswith("/obstacles") for name, _ in shown)
    assert np.abs(done.payloads[:, 0, :2]).max() > 1e-3


def test_a_payload_taken_off_leaves_the_replay():
    robot = bb.Params.paper().with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=90.0)
    event = {"term": "payload_mass", "mode": "at", "at": 0.2, "range": [0.0, 0.0]}
    done = bb.simulate("lqr", robot=robot, seconds=0.4, events=[event])
    assert done.payloads.shape == (41, 2, 6)
    check(record(done), done, [0, 40])


def test_a_replay_has_title_numbers_and_curves(done, tmp_path):
    path = tmp_path / "a.html"
    path.write_text("old", encoding="utf-8")
    done.write(path)
    text = re.sub('srcdoc="[^"]*"', "", path.read_text(encoding="utf-8"))
    assert "<h1>LQR on contact, 1.00 s, upright to the end</h1>" in text
    assert f"{np.degrees(done.metrics().tilt_max):.4g} deg" in text
    assert "(0.3, 0.1, 0) N·s at 0.4 s" in text
    assert "Robot paper." in text
    assert f"ballbot_rs {bb.__version__}" in text
    assert "://" not in text
    # A line in each of the five axes.
    assert text.count("--seconds: 1") == text.count("<i ") == 5
    assert [file.name for file in tmp_path.iterdir()] == ["a.html"]


def test_a_replay_names_no_folder_of_the_machine(done, tmp_path):
    dataclasses.replace(cut(done, 2), controller="/home/me/mine/best_model.zip").to_html(tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<h1>mine on contact" in text
    assert "/home" not in text
    assert str(tmp_path) not in text


def test_the_same_trajectory_gives_the_same_file_in_any_thread(done):
    before = threading.active_count()
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(record, [done, done])
    assert first == second
    # Threads of earlier tests may end meanwhile.
    assert threading.active_count() <= before


def test_it_opens_no_port(done, monkeypatch):
    def refuse(*_):
        raise OSError("there is no network")

    monkeypatch.setattr("socket.socket.bind", refuse)
    monkeypatch.setattr("socket.socket.connect", refuse)
    record(done, frame_rate=5.0)


def cut(trajectory, count):
    return dataclasses.replace(
        trajectory,
        **{name: getattr(trajectory, name)[:count] for name in ("times", "states", "contacts", "torques")},
        setpoints={part: values[:count] for part, values in trajectory.setpoints.items()},
    )


def test_one_row_is_a_picture(done, tmp_path):
    one = cut(done, 1)
    one.to_html(tmp_path / "new" / "a.html")
    assert check(document_of(tmp_path / "new" / "a.html"), one, [0]).seconds == 0.0


def test_a_robot_that_falls_lies_at_the_end():
    fallen = bb.simulate("zero", tilt=(0.2, 0.1), seconds=1.5)
    assert fallen.fell_at is not None
    replayed = check(record(fallen, forces=True), fallen, [0, len(fallen.times) - 1])
    assert replayed.at(0.1)["/world/forces", "visible"]


@pytest.mark.parametrize(
    ("options", "node"),
    [
        ({"task": "path"}, "command_0_0/curve"),
        ({"task": "goal", "robot": "kugle"}, "command_0_0/goal"),
        (
            {"task": "velocity", "seed": 1, "robot": bb.Params.preset("kugle").replace(ball_radius=0.2)},
            "command_0_0/way",
        ),
        ({"task": "push"}, "command_0_0/goal"),
        ({"reference": bb.Reference.circle(0.3, 6.0)}, "reference"),
        ({"terrain": {"kind": "plane", "slope": 0.1}, "robot": "rezero"}, "ground/sheet"),
        ({"events": "mild", "sensors": "kugle", "observation": "sensors", "model": "rigid"}, "setpoint"),
    ],
    ids=lambda value: None if isinstance(value, str) else "-".join(value),
)
def test_commands_and_ground_are_shown(options, node):
    done = bb.simulate("lqr", seconds=0.3, **options)
    replayed = check(record(done, frame_rate=20.0), done, [0, len(done.times) - 1])
    made = {message["name"] for _, message in replayed.messages if "name" in message}
    assert f"/world/{node}" in made
    assert replayed.at(0.0).get((f"/world/{node}", "visible"), True)


def test_a_recording_of_the_page_without_setpoints_is_replayed(done, tmp_path):
    later = dataclasses.replace(done, setpoints={}, times=done.times + 2.0)
    later.to_html(tmp_path / "a.html", frame_rate=10.0)
    check(document_of(tmp_path / "a.html"), later, [0, 100])
    assert np.isnan(later.metrics().position_error_rms)
    assert "position error" not in re.sub('srcdoc="[^"]*"', "", (tmp_path / "a.html").read_text(encoding="utf-8"))


def test_a_driven_robot_of_the_page_has_its_command():
    driven = dataclasses.replace(bb.simulate("lqr", task="velocity", seed=1, seconds=0.1), setpoints={})
    assert check(record(driven), driven, [0, 10]).at(0.0)["/world/command_0_0/way", "visible"]


def test_colors_are_light_or_dark(done, tmp_path):
    for dark, colors in ((False, LIGHT), (True, DARK)):
        document = record(cut(done, 1), dark=dark)
        assert CONFIG % str(dark).lower() in document
        floors = [one for _, one in Replayed(document).messages if one.get("name") == "/floor"]
        props = [props for one in floors for name, props in one.items() if name in ("props", "updates")]
        assert [tuple(one["plane_color"]) for one in props if "plane_color" in one][-1] == colors.plane
    cut(done, 1).to_html(tmp_path / "a.html", dark=True)
    assert 'style="color-scheme: dark"' in (tmp_path / "a.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.htm", {}, r"a\.htm: the name of the file must end in \.html"),
        ("a.html", {"frame_rate": 0.0}, "frame_rate = 0.0 is out of range: expected 1 to 240"),
        ("a.html", {"frame_rate": np.nan}, "frame_rate = nan is out of range"),
        ("a.html", {"frame_rate": "60"}, "frame_rate = '60' is not a number"),
    ],
)
def test_bad_arguments_are_named(done, name, options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        done.to_html(tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_without_viser_its_extra_is_named(tmp_path):
    code = """
import sys
sys.modules["viser"] = None
import ballbot_rs as bb
try:
    bb.simulate("lqr", seconds=0.1).to_html(sys.argv[1])
except ModuleNotFoundError as error:
    print(error)
"""
    command = [sys.executable, "-c", code, str(tmp_path / "a.html")]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert re.match(r"a replay needs viser: install it with `pip install .*\[view\]'`", found)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("times", "rate", "rows"),
    [
        ([0.0], 60.0, [0]),
        ([0.0, 0.01], 60.0, [0, 1]),
        (np.arange(11) * 0.1, 5.0, [0, 2, 4, 6, 8, 10]),
        # More frames than rows, and rows at uneven times.
        ([0.0, 0.1, 0.9, 1.0], 60.0, [0, 1, 2, 3]),
        ([5.0, 5.04, 5.07, 5.2], 10.0, [0, 2, 3]),
    ],
)
def test_frames_are_the_nearest_rows(times, rate, rows):
    assert rows_at(np.array(times), rate) == rows


@pytest.mark.slow("a browser draws in software")
@pytest.mark.skipif(find_browser() is None, reason="NO BROWSER: replays are not looked at")
def test_a_browser_without_a_network_plays_it(done, tmp_path):
    done.to_html(tmp_path / "a.html", frame_rate=30.0)
    page = Chromium(find_browser(), tmp_path)
    try:
        page.call("Network.enable")
        page.call(
            "Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=-1, uploadThroughput=-1
        )
        page.call("Emulation.setDeviceMetricsOverride", width=800, height=700, deviceScaleFactor=0.5, mobile=False)
        page.call("Page.navigate", url=(tmp_path / "a.html").as_uri())
        page.wait_for("document.querySelector('.timed i')")
        clock = "Number(document.documentElement.style.getPropertyValue('--time'))"
        # To its end, and again from its beginning.
        page.wait_for(f"{clock} === 1")
        page.wait_for(f"{clock} > 0.1 && {clock} < 1")
        line = "document.querySelector('.timed i')"
        left = f"parseFloat(getComputedStyle({line}, '::after').left) / {line}.getBoundingClientRect().width"
        moving = page.evaluate(f"[{clock}, {left}, {clock}]")
        assert moving[0] - 0.01 <= moving[1] <= moving[2] + 0.01
        # A click on the player stops it, and the scene is drawn: the red of the ball, the blue of the body.
        x, y, width, height = page.evaluate(
            "(b => [b.x, b.y, b.width, b.height])(document.querySelector('iframe').getBoundingClientRect())"
        )
        page.click(x + 0.5 * width, y + height - 19)
        image = pytest.importorskip("PIL.Image", reason="the picture is not looked at: Pillow is missing")

        def is_drawn():
            page.screenshot(tmp_path / "last.png")
            box = [round(0.5 * one) for one in (x + 0.4 * width, y, x + 0.6 * width, y + 0.9 * height)]
            colors = np.asarray(image.open(tmp_path / "last.png").convert("RGB").crop(box), dtype=int)
            red, _, blue = np.moveaxis(colors, 2, 0)
            return (red - blue > 80).sum() > 100 and (blue - red > 40).sum() > 100

        wait_until(is_drawn)
        stopped = page.evaluate(clock)
        time.sleep(0.3)
        assert page.evaluate(clock) == stopped
        # Requests in a frame are not reported: its document by itself makes none, also without the policy of the page.
        (tmp_path / "document.html").write_text(document_of(tmp_path / "a.html"), encoding="utf-8")
        page.call("Page.navigate", url=(tmp_path / "document.html").as_uri())
        page.wait_for("document.querySelector('canvas')")
        time.sleep(1.0)
        assert page.evaluate("performance.getEntriesByType('resource').map(entry => entry.name)") == []
        assert page.errors == []
    finally:
        page.close()
