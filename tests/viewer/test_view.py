"""`ballbot view` as a user meets it: the command, the server, and the page in a headless Chromium."""

import asyncio
import contextlib
import io
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from PIL import Image  # noqa: E402
from websockets.exceptions import ConnectionClosed  # noqa: E402

from ballbot_rs import Params  # noqa: E402
from ballbot_rs.media.shapes import COLORS  # noqa: E402
from ballbot_rs.viewer.panels.plots import PLOTS  # noqa: E402
from ballbot_rs.viewer.scene import look, urdf  # noqa: E402
from ballbot_rs.viewer.scene.cameras import FREE  # noqa: E402
from ballbot_rs.viewer.server.server import free_port  # noqa: E402
from ballbot_rs.viewer.session import Session  # noqa: E402
from ballbot_rs.viewer.view import View  # noqa: E402
from tests.support.chromium import Chromium, find_browser  # noqa: E402
from tests.support.paths import ASSETS  # noqa: E402
from tests.support.view import connect, query  # noqa: E402
from tests.support.waiting import wait_until  # noqa: E402

pytestmark = pytest.mark.slow("a browser")


@pytest.fixture
def view():
    view = View(Session(), port=18730)
    yield view
    view.stop()
    assert view.runner.error is None


def state(view):
    return query(view, lambda session: session.frame().states[0])


def button(name):
    return f"[...document.querySelectorAll('button, [role=tab]')].find(b => b.innerText.trim() === '{name}')"


def click(page, expression):
    page.click(*page.place_of(expression))


def choose(page, label, option):
    """Picks an option of a dropdown as a user does."""
    field = f"[...document.querySelectorAll('label')].find(l => l.innerText.trim() === '{label}')"
    click(page, f"({field}).closest('.mantine-Flex-root, div').parentElement.querySelector('input')")
    matches = f"o => o.offsetParent && o.innerText.trim() === '{option}'"
    found = f"[...document.querySelectorAll('[role=option]')].find({matches})"
    page.wait_for(found)
    # A long list scrolls.
    page.evaluate(f"({found}).scrollIntoView({{block: 'center'}})")
    click(page, found)


def scene_of(picture):
    """The part of a screenshot that the controls do not cover."""
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))[:, :860].astype(int)


@pytest.mark.skipif(find_browser() is None, reason="NO BROWSER: the page is not tested; `sh tools/install_chromium.sh`")
def test_the_page_in_a_browser(view, tmp_path):
    # Shadows are slow to draw in software; the setpoint stays where it is seen.
    view._page._scene.shows_shadow = False
    view._page._scene.camera.kind = FREE
    page = Chromium(find_browser(), tmp_path)
    try:
        page.call("Page.navigate", url=view.url)
        page.wait_for(f"document.querySelector('canvas') && {button('Push')}")

        # The scene has the ball's red, the wheels' blue and the top's orange.
        def shows_a_robot():
            colors = scene_of(page.screenshot(tmp_path / "page.png"))
            red, green, blue = colors.transpose(2, 0, 1)
            seen = {
                "ball": (red > 1.8 * green) & (red > 1.8 * blue),
                "wheels": (blue > 1.8 * red) & (blue > 1.3 * green),
                "top": (red > 1.3 * green) & (green > 2 * blue) & (red > 150),
            }
            return all(mask.sum() > 20 for mask in seen.values())

        wait_until(shows_a_robot)

        # A push at rest moves the robot.
        view.runner.submit(lambda session: session.reset((0.0, 0.0)))
        assert np.abs(state(view)[7:9]).max() < 1e-6
        page.click_until(lambda: np.linalg.norm(state(view)[7:9]) > 0.01, button("Push"))

        # The text reports what the session does.
        page.wait_for("/ s\\s*running/.test(document.querySelector('.ballbot-status').innerText)")

        # A click on the floor moves the setpoint there, and the page shows it where the click was. The camera,
        # which begins elsewhere, has to be known first.
        (viewer,) = view.server.get_clients().values()
        wait_until(lambda: viewer.camera.position[0] < 0.0)
        # A robot that reaches its setpoint hides it from a page that shows it late.
        query(view, lambda s: setattr(s, "paused", True))
        page.click(300, 560)
        wait_until(lambda: np.linalg.norm(query(view, lambda s: s.setpoint)) > 0.1)
        goal = query(view, lambda s: s.setpoint)

        def shows_the_goal():
            red, green, blue = scene_of(page.screenshot(tmp_path / "goal.png"))[540:580, 280:320].transpose(2, 0, 1)
            return ((green > 1.5 * red) & (green > 1.3 * blue)).sum() > 20

        wait_until(shows_the_goal)
        query(view, lambda s: setattr(s, "paused", False))

        # A drag turns the camera and is not a click.
        eye = np.array(viewer.camera.position)
        page.drag((300, 600), (420, 560))
        wait_until(lambda: np.linalg.norm(viewer.camera.position - eye) > 0.1)
        time.sleep(0.5)
        assert np.array_equal(query(view, lambda s: s.setpoint), goal)

        # Controllers and models are chosen while it runs.
        click(page, button("Robot"))
        for label, option, chosen in (
            ("Controller", "pid", lambda s: s.controller),
            ("Controller", "lqr", lambda s: s.controller),
            ("Model", "rigid", lambda s: s.robots.model),
            ("Robot", "kugle", lambda s: s.robots.name),
        ):
            choose(page, label, option)
            wait_until(lambda option=option, chosen=chosen: query(view, chosen) == option)

        # A single step pauses; a replay stays open at its end.
        page.click_until(lambda: query(view, lambda s: s.paused), button("Run"), button("Step"))
        time_ = query(view, lambda s: s.time)
        page.click_until(lambda: query(view, lambda s: s.time) == pytest.approx(time_ + 0.01), button("Step"))
        view.runner.submit(lambda session: setattr(session, "paused", False))
        record = "[...document.querySelectorAll('button')].find(b => b.innerText.trim() === 'Record')"
        page.click_until(lambda: query(view, lambda s: s.is_recording), button("Record"), record)
        wait_until(lambda: query(view, lambda s: s.recording.duration) > 0.3)
        page.click_until(lambda: query(view, lambda s: s.replay_time is not None), button("Replay"))
        at_end = lambda s: s.replay_time is not None and s.replay_time == s.recording.duration  # noqa: E731
        wait_until(lambda: query(view, at_end))
        page.wait_for("/replay, /.test(document.querySelector('.ballbot-status').innerText)")
        page.click_until(lambda: query(view, lambda s: s.replay_time is None), button("Back to the simulation"))

        # Plots draw.
        shown = "document.querySelectorAll('.uplot canvas').length"
        page.click_until(lambda: page.evaluate(f"{shown} > 0"), button("Plots"))
        page.wait_for(f"{shown} === {len(PLOTS)}")
        page.screenshot(tmp_path / "plots.png")
        assert page.errors == []
    finally:
        page.close(tmp_path / "last.png")
    # The client that vanished left no trace.
    before = query(view, lambda session: session.time)
    wait_until(lambda: query(view, lambda session: session.time) > before + 0.2)
    assert not query(view, lambda session: list(session.notices))


@pytest.mark.skipif(find_browser() is None, reason="NO BROWSER: the page is not tested; `sh tools/install_chromium.sh`")
def test_dragging_the_robot_pulls_it(view, tmp_path):
    # Shadows are slow to draw in software; the setpoint stays where it is seen.
    view._page._scene.shows_shadow = False
    view._page._scene.camera.kind = FREE
    page = Chromium(find_browser(), tmp_path)
    try:
        page.call("Page.navigate", url=view.url)
        page.wait_for(f"document.querySelector('canvas') && {button('Push')}")
        wait_until(lambda: view.server.get_clients())
        time.sleep(2.0)
        view.runner.submit(lambda session: session.reset((0.0, 0.0)))
        pulls = []

        def listen(session):
            pull = session.pull
            session.pull = lambda point: (pulls.append(point), pull(point))

        view.runner.submit(listen)
        # The mast is in the middle of the scene.
        scene = "document.querySelector('canvas[data-engine]').getBoundingClientRect()"
        mast = page.evaluate(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({scene})")
        page.drag(mast, (mast[0] + 90, mast[1]))
        page.screenshot(tmp_path / "drag.png")
        # The robot was pulled to the right, then released; the end of the drag was not taken for a click on the floor.
        wait_until(lambda: pulls and pulls[-1] is None)
        assert max(point[0] for point in pulls if point is not None) > 0.1
        assert np.array_equal(query(view, lambda session: session.setpoint), [0.0, 0.0])
        # viser 1.1.1 stops the default of a passive event in a drag, which Chromium notes.
        assert [error for error in page.errors if "inside passive event listener" not in error] == []
    finally:
        page.close()


def test_the_urdf_and_the_parameters_agree_on_the_positions_of_the_wheels():
    params = Params.paper()
    described, made = urdf.from_urdf(params, *urdf.URDFS["paper"]), look.from_params(params)
    for one, other in zip(described.wheels, made.wheels, strict=True):
        np.testing.assert_allclose(one.mount, other.mount, atol=1e-12)
        np.testing.assert_allclose(one.axle, other.axle, atol=1e-12)
        # Where the rim is nearest to the ball center, it touches the ball.
        for wheel in (one, other):
            tyre = next(piece for piece in wheel.pieces if piece.color == COLORS["tyre"])
            points = tyre.vertices @ wheel.mount[:3, :3].T + wheel.mount[:3, 3]
            assert np.linalg.norm(points, axis=1).min() == pytest.approx(params.ball_radius, abs=1e-3)
    # The colors of its materials, and a mast well above the wheels.
    assert len({piece.color for piece in described.body}) == len(described.body) > 2
    assert 0.5 < max(piece.vertices[:, 2].max() for piece in described.body) < 0.7


def test_uneven_wheels_are_shown_where_they_are():
    params = Params.paper().replace(wheel_azimuths=[0.3, 2.0, 4.0], wheel_zenith_offsets=[0.0, 0.15, -0.1])
    reach = params.ball_radius + params.wheel_radius
    for wheel, zenith, azimuth in zip(
        look.from_params(params).wheels, params.wheel_zeniths, params.wheel_azimuths, strict=True
    ):
        sin, cos = np.sin(zenith), np.cos(zenith)
        contact = np.array([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])
        np.testing.assert_allclose(wheel.mount[:3, 3], reach * contact, atol=1e-15)
        axle = np.cross([-np.sin(azimuth), np.cos(azimuth), 0.0], contact)
        np.testing.assert_allclose(wheel.mount[:3, :3] @ wheel.axle, axle, atol=1e-15)


def test_the_command_stops_by_itself_and_prints_its_speed():
    command = [sys.executable, "-m", "ballbot_rs.cli", "view", "--model", "contact", "--batch", "16"]
    done = subprocess.run(
        [*command, "--seconds", "2", "--no-open", "--port", "18740"],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert "http://127.0.0.1:" in done.stdout
    assert "real-time factor" in done.stdout
    assert "16 robots paper, contact, lqr" in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {"Host": "evil.example"}),
        ("/", {"Origin": "https://evil.example"}),
        ("/", {"Origin": "null"}),
        ("/../../../../../../../../../../etc/passwd", {}),
        ("/assets/../../../__init__.py", {}),
        ("//etc/passwd", {}),
        ("/C:/Windows/win.ini", {}),
        ("/..\\..\\x", {}),
        ("/..%5C..%5Cx", {}),
    ],
)
def test_other_sites_and_other_files_are_rejected(view, path, headers):
    with pytest.raises(urllib.error.HTTPError) as rejected:
        urllib.request.urlopen(urllib.request.Request(view.url + path, headers=headers), timeout=60)
    assert rejected.value.code == 403


def test_a_search_for_a_free_port_ends():
    with socket.socket() as taken:
        with contextlib.suppress(OSError):
            taken.bind(("127.0.0.1", 65535))
            taken.listen()
        with pytest.raises(OSError, match="no port is free from 65535 to 65535"):
            free_port(65535)
    assert 18800 <= free_port(18800) <= 65535


def test_a_urdf_whose_mesh_is_missing_is_rejected(tmp_path):
    bot, ball = (tmp_path / name for name in ("bot.urdf", "ball.urdf"))
    for path in (bot, ball):
        path.write_bytes((ASSETS / path.name).read_bytes())
    with pytest.raises((OSError, ValueError), match=r"\.stl"):
        View(Session(), port=18790, urdfs={"paper": (bot, ball)})


def test_the_page_is_served_and_makes_no_external_requests(view):
    with urllib.request.urlopen(view.url, timeout=60) as answer:
        page = answer.read().decode()
    assert '<div id="root">' in page
    assert "gtag" not in page
    assert "<title>ballbot</title>" in page
    assert view.server.request_share_url() is None


def test_garbage_and_many_clients_that_vanish_do_no_harm(view, capfd):
    address = view.url.replace("http", "ws")
    for garbage in (b"\xff\x00garbage", b"", "text", b"\x81\xa4type\xa7NoSuchM", b"\xc1" * 1000):
        # The server may close the connection at any time.
        with contextlib.suppress(ConnectionClosed), connect(address, max_size=None, close_timeout=0.1) as client:
            client.send(garbage)
    with contextlib.suppress(ConnectionClosed), contextlib.ExitStack() as stack:
        for client in [stack.enter_context(connect(address, max_size=None, close_timeout=0.1)) for _ in range(8)]:
            client.socket.shutdown(socket.SHUT_RDWR)
    before = query(view, lambda session: session.time)
    wait_until(lambda: query(view, lambda session: session.time) > before + 0.3)
    with urllib.request.urlopen(view.url, timeout=60) as answer:
        assert answer.status == 200
    capfd.readouterr()


def test_choices_that_are_not_offered_are_rejected(view):
    """Text that a client other than a browser may put into a control; viser accepts all text."""
    panel = view._page.robot
    event = viser.GuiEvent(client=None, client_id=3, target=None)
    controls = (panel.model, panel.robot, panel.count, panel.controller)
    now = [control.value for control in controls]
    for values in (("flat", "nobody", "1e9", "../x"), ("", "", "", ""), ("rigid\0", "kugle", "-1", "a.pkl")):
        for control, value in zip(controls, values, strict=True):
            control.value = value
        asyncio.run(panel._choose(event))
        wait_until(lambda: [control.value for control in controls] == now)
    assert query(view, lambda s: (s.robots.model, s.robots.name, s.controller)) == ("contact", "paper", "lqr")
    assert query(view, lambda session: len(session.notices)) == 3


def test_a_viser_that_cannot_be_restricted_is_not_used(monkeypatch):
    import viser

    from ballbot_rs.viewer.server.server import LocalServer
    from ballbot_rs.viewer.server.teleop import Teleop

    stopped = []
    monkeypatch.setattr(viser.ViserServer, "__init__", lambda *_, **__: None)
    monkeypatch.setattr(viser.ViserServer, "stop", lambda _: stopped.append(True))
    with pytest.raises(RuntimeError, match="it cannot be restricted"):
        LocalServer(18770, Teleop(lambda _: True))
    assert stopped == [True]
