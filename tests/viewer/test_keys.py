"""Keyboard and gamepad of the page in a headless Chromium."""

import time

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from ballbot_rs.viewer.session import Session  # noqa: E402
from ballbot_rs.viewer.view import View  # noqa: E402
from tests.support.chromium import Chromium, find_browser  # noqa: E402
from tests.support.view import query  # noqa: E402
from tests.support.waiting import wait_until  # noqa: E402

#: Virtual key codes by the code of a key.
CODES = {"KeyW": 87, "KeyA": 65, "KeyQ": 81, "KeyE": 69, "KeyS": 83, "ArrowLeft": 37, "Space": 32}

#: A gamepad whose sticks a test moves: `pad.axes`.
GAMEPAD = """
window.pad = {connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons: []};
navigator.getGamepads = () => [null, window.pad];
"""


def send_key(page, kind, code):
    page.call("Input.dispatchKeyEvent", type=kind, code=code, key=code[-1].lower(), windowsVirtualKeyCode=CODES[code])


def down(page, code):
    send_key(page, "keyDown", code)


def up(page, code):
    send_key(page, "keyUp", code)


def stays(viewer, eye):
    """Whether a camera has been at a position for a second; the position is overwritten by the present position."""
    before = eye.copy()
    time.sleep(1.0)
    eye[:] = viewer.camera.position
    return (eye == before).all()


@pytest.mark.slow("a browser")
@pytest.mark.skipif(find_browser() is None, reason="NO BROWSER: the page is not tested; `sh tools/install_chromium.sh`")
def test_keys_and_sticks_drive_in_a_browser(tmp_path):
    # Nothing is sampled: robots move only by keys.
    session = Session(task="velocity", task_options={"standing": 1.0})
    view = View(session, port=18880)
    view._page._scene.shows_shadow = False
    page = Chromium(find_browser(), tmp_path)

    def command():
        return query(view, lambda session: session.frame().commands.values[0])

    def ball():
        return query(view, lambda session: session.robots.states[0].ball_position[:2])

    def becomes(*expected):
        wait_until(lambda: np.allclose(command(), expected, atol=1e-9))

    try:
        page.call("Emulation.setFocusEmulationEnabled", enabled=True)
        page.call("Page.addScriptToEvaluateOnNewDocument", source=GAMEPAD)
        page.call("Page.navigate", url=view.url)
        page.wait_for("document.querySelector('canvas') && /Drive/.test(document.body.innerText)")
        wait_until(lambda: view.server.get_clients())
        (viewer,) = view.server.get_clients().values()
        # It is put before the robot once the page is there.
        wait_until(lambda: viewer.camera.position[0] < 0.0)
        eye = np.array(viewer.camera.position)
        wait_until(lambda: stays(viewer, eye))

        # A key drives while it is down, two together drive diagonally, and opposite keys cancel.
        down(page, "KeyW")
        becomes(0.5, 0.0, 0.0)
        assert query(view, lambda session: session.frame().commands.by_hand)
        page.wait_for("/0.50 m.s forward \\(by hand\\)/.test(document.querySelector('.ballbot-status').innerText)")
        wait_until(lambda: np.linalg.norm(ball()) > 3.2)
        page.screenshot(tmp_path / "drive.png")
        down(page, "ArrowLeft")
        becomes(0.5 / 2**0.5, 0.5 / 2**0.5, 0.0)
        up(page, "KeyW")
        becomes(0.0, 0.5, 0.0)
        up(page, "ArrowLeft")
        becomes(0.0, 0.0, 0.0)
        down(page, "KeyQ")
        becomes(0.0, 0.0, 1.0)
        down(page, "KeyE")
        becomes(0.0, 0.0, 0.0)
        up(page, "KeyQ")
        becomes(0.0, 0.0, -1.0)
        # Space stops, though the key is still down.
        down(page, "Space")
        up(page, "Space")
        becomes(0.0, 0.0, 0.0)
        time.sleep(0.5)
        becomes(0.0, 0.0, 0.0)
        up(page, "KeyE")

        # viser's camera uses the same keys, but has received none of them.
        np.testing.assert_allclose(viewer.camera.position, eye, atol=1e-12)

        # Lost focus stops; the key that is still down does not start again by itself.
        down(page, "KeyS")
        becomes(-0.5, 0.0, 0.0)
        page.evaluate("window.dispatchEvent(new Event('blur'))")
        becomes(0.0, 0.0, 0.0)
        up(page, "KeyS")

        # Sticks: left for the velocity, right for the turn; small angles count as a stick at rest.
        page.evaluate("window.pad.axes = [0.05, -0.1, 0.1, 1]")
        time.sleep(0.5)
        becomes(0.0, 0.0, 0.0)
        page.evaluate("window.pad.axes = [0, -1, 0, 0]")
        becomes(0.5, 0.0, 0.0)
        page.evaluate("window.pad.axes = [-0.56, 0, 1, 0]")
        becomes(0.0, 0.25, -1.0)
        # Space stops until the sticks have been released.
        down(page, "Space")
        up(page, "Space")
        becomes(0.0, 0.0, 0.0)
        time.sleep(0.5)
        becomes(0.0, 0.0, 0.0)
        page.evaluate("window.pad.axes = [0, 0, 0, 0]")
        time.sleep(0.5)
        page.evaluate("window.pad.axes = [1, 0, 0, 0]")
        becomes(0.0, -0.5, 0.0)
        page.evaluate("window.pad.axes = [0, 0, 0, 0]")
        becomes(0.0, 0.0, 0.0)

        # The camera has stayed, with the robot in the middle: a click near it is a goal near it.
        assert np.linalg.norm(ball()) > 2.0
        view.runner.submit(lambda session: session.choose(task="goal"))
        page.wait_for("/Click on the floor/.test(document.body.innerText) && !/Drive/.test(document.body.innerText)")
        # The robot waits for the page, however slow that is.
        view.runner.submit(lambda session: setattr(session, "paused", True))
        time.sleep(1.0)
        where = ball()
        # Next to the robot, which is pulled by a drag and not clicked.
        page.click(250, 520)
        wait_until(lambda: query(view, lambda session: session.frame().commands.by_hand))
        assert np.linalg.norm(command() - where) < 1.5
        view.runner.submit(lambda session: setattr(session, "paused", False))

        # Where there is nothing to drive, the keys move the camera.
        view.runner.submit(lambda session: session.choose(task="path"))
        page.wait_for("!/Click on the floor/.test(document.body.innerText)")
        down(page, "KeyW")
        wait_until(lambda: np.linalg.norm(viewer.camera.position - eye) > 0.05)
        up(page, "KeyW")
        view.runner.submit(lambda session: session.choose(task="velocity"))
        page.wait_for("/Drive/.test(document.body.innerText)")

        # What is typed into a field is text.
        tab = "[...document.querySelectorAll('[role=tab]')].find(b => b.innerText.trim() === 'Robot')"
        view.runner.submit(lambda _: setattr(view._page.robot.policy, "visible", True))
        label = "[...document.querySelectorAll('label')].find(l => l.innerText.trim() === 'Policy file')"
        field = f"{label}?.closest('.mantine-Flex-root, div').parentElement.querySelector('input')"
        # The tab each time: on a busy machine it may not stay selected.
        page.click_until(lambda: page.evaluate(f"document.activeElement === {field}"), tab, field)
        down(page, "KeyW")
        time.sleep(0.5)
        becomes(0.0, 0.0, 0.0)
        up(page, "KeyW")
        # A click on the scene gives the keys back.
        page.click(300, 560)
        down(page, "KeyW")
        becomes(0.5, 0.0, 0.0)

        # A page that is gone, keys down, stops.
        page.call("Page.navigate", url="about:blank")
        becomes(0.0, 0.0, 0.0)
        assert not page.errors
    finally:
        page.close(tmp_path / "last.png")
        view.stop()
    assert view.runner.error is None
