"""The page in a browser, on a desk and on a phone: every control, what can be read, and what is in front of what."""

import contextlib
import json
import time

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from ballbot_rs.analysis.sensitivity import SHOWN
from ballbot_rs.viewer.panels.plots import PLOTS
from ballbot_rs.viewer.server.download import KINDS
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.session.setup import CHANGES
from ballbot_rs.viewer.view import View
from tests.support.chromium import Chromium, find_browser
from tests.support.view import query
from tests.support.waiting import wait_until

pytestmark = [
    pytest.mark.slow("a browser"),
    pytest.mark.skipif(
        find_browser() is None, reason="NO BROWSER: the page is not tested; `sh tools/install_chromium.sh`"
    ),
]

SIZES = {"desk": (1400, 900), "phone": (390, 844)}

#: Contrast of each text with what is behind it, as WCAG 2 has it; what is disabled need not be legible.
CONTRASTS = """
(() => {
  const rgba = (text) => {
    const parts = text.match(/[\\d.]+/g).map(Number);
    const scale = text.startsWith("color(") ? 255 : 1;
    return [...parts.slice(0, 3).map((c) => c * scale), parts[3] ?? 1];
  };
  const over = (top, below) => top.slice(0, 3).map((c, i) => c * top[3] + below[i] * (1 - top[3]));
  const light = (color) => {
    const [r, g, b] = color.map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const text = walker.currentNode.textContent.trim();
    const isRead = text && element.offsetParent && !element.closest("script, style, :disabled, [data-disabled]");
    if (!isRead) continue;
    const above = [];
    for (let e = element; e; e = e.parentElement) above.push(getComputedStyle(e));
    let behind = [255, 255, 255];
    for (const style of [...above].reverse()) behind = over(rgba(style.backgroundColor), behind);
    const color = rgba(above[0].color);
    color[3] *= above.reduce((product, style) => product * Number(style.opacity), 1);
    const [a, b] = [light(over(color, behind)), light(behind)];
    found.push([text, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)]);
  }
  return found;
})()
"""

HELP_IS_OPEN = "Boolean(document.querySelector('dialog.ballbot-help[open]'))"


def named(name, kind="button, [role=tab]"):
    return f"[...document.querySelectorAll('{kind}')].find(b => b.offsetParent && b.innerText.trim() === '{name}')"


def labelled(label):
    """The first input of a control."""
    found = f"[...document.querySelectorAll('label')].find(l => l.innerText.trim() === {json.dumps(label)})"
    return (
        f"document.getElementById(({found}).htmlFor) ?? ({found}).closest('.mantine-Flex-root').querySelector('input')"
    )


def press(page, expression, condition):
    page.click_until(condition, expression)


def rectangle(page, expression):
    return page.evaluate(f"(b => [b.left, b.top, b.right, b.bottom])(({expression}).getBoundingClientRect())")


@pytest.fixture(scope="module", params=SIZES)
def opened(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    view = View(Session(), port=18920)
    # They are rendered in software, which takes most of the time.
    view._page._scene.shows_shadow = False
    page = Chromium(find_browser(), folder)
    page.call("Network.enable")
    width, height = SIZES[request.param]
    # Few pixels: they are rendered in software.
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=0.3, mobile=False)
    page.call("Page.navigate", url=view.url)
    page.wait_for(f"document.querySelector('canvas[data-engine]') && {named('Push')}")
    wait_until(lambda: view.server.get_clients())
    yield view, page, folder
    page.close(folder / "last.png")
    view.stop()
    assert view.runner.error is None
    assert page.errors == []


def open_tab(page, name):
    press(page, named(name, "[role=tab]"), lambda: page.evaluate(f"{named(name, '[role=tab]')}.ariaSelected") == "true")


def test_the_panel_is_next_to_the_scene_and_the_robot_in_it(opened):
    view, page, _ = opened
    scene = rectangle(page, "document.querySelector('canvas[data-engine]')")
    panel = rectangle(page, "document.querySelector('.ballbot-status')")
    width, height = page.evaluate("[innerWidth, innerHeight]")
    assert panel[0] >= scene[2] - 1 or panel[1] >= scene[3] - 1
    assert panel[2] <= width + 1
    assert (scene[2] - scene[0]) * (scene[3] - scene[1]) > 0.4 * width * height
    # The top of the robot, and the floor at its sides, are projected into the picture.
    (client,) = view.server.get_clients().values()
    wait_until(lambda: abs(client.camera.fov - 0.663) < 0.01)
    reach, top = view._page._scene.extent("paper", 1)
    up = np.array([0.0, 0.0, 1.0])
    for point in (top * up, 0.0 * up, [reach, 0, 0.1], [-reach, 0, 0.1], [0, reach, 0.1], [0, -reach, 0.1]):
        eye, target = np.array(client.camera.position), np.array(client.camera.look_at)
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
        seen = np.array([right, np.cross(right, forward), forward]) @ (np.asarray(point) - eye)
        half = np.tan(0.5 * client.camera.fov)
        assert abs(seen[1] / seen[2]) < half
        assert abs(seen[0] / seen[2]) < half * client.camera.aspect


def test_tabs_stay_under_the_finger(opened):
    _, page, _ = opened
    open_tab(page, "Run")
    # The panel grows while the page loads.
    page.wait_for("document.querySelector('[role=tab]').getBoundingClientRect().top < 0.65 * innerHeight")
    seen = []
    for tab in ("Run", "Robot", "Parameters", "Plots", "Record", "View", "Run"):
        open_tab(page, tab)
        ends = time.monotonic() + 0.5
        while time.monotonic() < ends:
            seen.append(rectangle(page, named(tab, "[role=tab]"))[1])
    assert max(seen) - min(seen) < 10


def test_every_text_can_be_read(opened):
    view, page, _ = opened
    assert page.evaluate("document.title") == "ballbot"
    query(view, lambda session: setattr(session, "paused", True))
    message = "a message that is longer than one line of the panel is " * 3
    wraps = "document.querySelector('.ballbot-status [role=alert]')?.getBoundingClientRect().height > 30"

    def is_shown():
        # A busy browser may draw nothing for as long as a message is shown.
        query(view, lambda session: session.notices.append(message))
        time.sleep(1.0)
        return page.evaluate(f"Boolean({wraps})")

    wait_until(is_shown)
    for tab in ("Run", "Robot", "Parameters", "Plots", "Record", "View"):
        open_tab(page, tab)
        # Tabs and buttons fade in; what is still faint then is named below.
        with contextlib.suppress(AssertionError):
            page.wait_for(f"(all => all.length > 15 && all.every(([_, ratio]) => ratio >= 4.5))({CONTRASTS.strip()})")
        texts = page.evaluate(CONTRASTS)
        assert len(texts) > 15
        assert [(text, ratio) for text, ratio in texts if ratio < 4.5] == []
    assert not page.evaluate("[...document.querySelectorAll('button')].some(b => /share/i.test(b.innerHTML))")
    # It is gone after a while.
    page.wait_for("!document.querySelector('.ballbot-status [role=alert]')")
    query(view, lambda session: setattr(session, "paused", False))


def test_every_button_does_what_its_label_states(opened):
    view, page, _ = opened

    def becomes(function, value=True):
        return lambda: query(view, function) == value

    query(view, lambda session: session.reset((0.0, 0.0)))
    open_tab(page, "Run")
    press(page, named("Push"), lambda: query(view, lambda s: s.pushed is not None))
    press(page, named("Pause"), becomes(lambda s: s.paused))
    before = query(view, lambda s: s.time)
    press(page, named("Step"), lambda: query(view, lambda s: s.time) > before)
    press(page, named("Continue"), becomes(lambda s: s.paused, False))
    press(page, named("Circle"), lambda: query(view, lambda s: s.frame().route is not None))
    press(page, named("Figure eight"), lambda: query(view, lambda s: s._objective._route.name == "eight"))
    press(page, named("Origin"), lambda: query(view, lambda s: s.frame().route is None))
    press(page, named("Reset"), lambda: query(view, lambda s: s.time) < 3.0)
    press(page, labelled("Click to go"), lambda: not view._page.run.clicks.value)
    press(page, labelled("Click to go"), lambda: view._page.run.clicks.value)
    open_tab(page, "View")
    scene = view._page._scene
    press(page, labelled("Trail"), lambda: not scene.shows_trail)
    press(page, labelled("Trail"), lambda: scene.shows_trail)
    press(page, labelled("Forces"), lambda: scene.shows_forces)
    shadow = next(handle for handle in view.server.controls.values() if handle.label == "Shadow")
    press(page, labelled("Shadow"), lambda: not shadow.value)
    press(page, labelled("Shadow"), lambda: shadow.value and scene.shows_shadow)
    scene.shows_shadow = False
    open_tab(page, "Record")
    press(page, named("Record", "button:not([role=tab])"), becomes(lambda s: s.is_recording))
    wait_until(lambda: query(view, lambda s: s.recording.duration) > 0.3)
    press(page, named("Stop recording"), becomes(lambda s: s.is_recording, False))
    press(page, named("Replay"), lambda: query(view, lambda s: s.replay_time is not None))
    press(page, named("Back to the simulation"), lambda: query(view, lambda s: s.replay_time is None))
    page.evaluate("document.querySelector('[data-ballbot=link]').dataset.query").index("robot=paper")
    press(page, "document.querySelector('[data-ballbot=help]')", lambda: page.evaluate(HELP_IS_OPEN))
    page.wait_for("document.querySelector('dialog.ballbot-help[open] kbd')")
    assert page.evaluate("fetch('/docs/view.md').then((answer) => answer.text())").startswith("# The page")
    press(page, "document.querySelector('dialog.ballbot-help form button')", lambda: not page.evaluate(HELP_IS_OPEN))
    open_tab(page, "Plots")
    page.wait_for(f"document.querySelectorAll('.uplot canvas').length === {len(PLOTS)}")
    assert page.evaluate("document.querySelectorAll('.ballbot-legend').length") == len(PLOTS)


def test_a_recording_comes_as_a_file_of_each_kind(opened, tmp_path):
    view, page, _ = opened
    page.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    open_tab(page, "Record")
    press(page, named("Record", "button:not([role=tab])"), lambda: query(view, lambda s: s.is_recording))
    wait_until(lambda: query(view, lambda s: s.recording.duration) > 0.5)
    press(page, named("Stop recording"), lambda: not query(view, lambda s: s.is_recording))
    first = {"CSV": b"time_s,", "MCAP": b"\x89MCAP0\r\n", "Video": b"\0\0\0 ftyp"}
    for kind, begins in first.items():
        path = tmp_path / f"ballbot{KINDS[kind]}"
        press(page, named(kind), path.exists)
        assert path.read_bytes().startswith(begins)


def test_every_slider_of_the_robot_is_on_the_page(opened):
    _, page, _ = opened
    open_tab(page, "Parameters")
    shown = page.evaluate(
        "[...document.querySelectorAll('label')].filter(l => l.offsetParent).map(l => l.innerText.trim())"
    )
    assert {change.label for change in CHANGES.values()} <= set(shown)


def test_sensitivities_are_folded_and_come_as_a_table_of_the_width_of_the_panel(opened):
    _, page, _ = opened
    open_tab(page, "Parameters")
    compute, table = named("Compute sensitivities"), "document.querySelector('.ballbot-table')"
    assert not page.evaluate(f"Boolean({compute})")
    # Once: a second click folds it again.
    page.evaluate("[...document.querySelectorAll('div')].findLast(e => e.innerText.trim() === 'Sensitivity').click()")
    press(page, compute, lambda: page.evaluate(f"Boolean({table})"))
    assert page.evaluate(f"{table}.rows.length") == SHOWN + 1
    panel, shown = (rectangle(page, one) for one in ("document.querySelector('.ballbot-status')", table))
    assert panel[0] <= shown[0]
    assert shown[2] <= panel[2]
    texts = page.evaluate(f"{table}.innerText")
    assert [(text, ratio) for text, ratio in page.evaluate(CONTRASTS) if text in texts and ratio < 4.5] == []


def test_a_link_restores_what_was_chosen(opened):
    view, page, _ = opened
    page.call(
        "Page.navigate", url=f"{view.url}/?robot=rezero&model=rigid&controller=pid&body_mass=1.2&compare=lqr&speed=2"
    )
    wait_until(lambda: query(view, lambda s: s.speed) == 2.0)
    now = query(
        view, lambda s: (s.robots.name, s.robots.model, s.controller, s.changes["body_mass"], s.ghost.controller)
    )
    assert now == ("rezero", "rigid", "pid", 1.2, "lqr")
    assert not query(view, lambda session: [n for n in session.notices if "link" in n])
    page.wait_for(f"document.querySelector('canvas[data-engine]') && {named('Push')}")
