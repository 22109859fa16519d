"""The simulator in the browser: motions of the core, and the page as users handle it. `make web` runs these tests.

BALLBOT_WEB names the folder of a built page.
"""

import gzip
import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.onnx_policy import FOLLOWING
from tests.support.chromium import Chromium, find_browser
from tests.support.serving import serving
from tests.support.waiting import wait_until

FOLDER = os.environ.get("BALLBOT_WEB")
if FOLDER is None:
    pytest.skip("BALLBOT_WEB names no built page: make web", allow_module_level=True)
BROWSER = find_browser()
if BROWSER is None:
    pytest.skip("no Chromium: the page is not looked at", allow_module_level=True)

#: Width, height and pixels per point: few pixels, since they are rendered in software.
SIZES = {"wide": (1000, 700, 0.4), "phone": (390, 800, 0.5)}

POLICIES = Path("assets/policies")

#: Time steps of a comparison.
STEPS = 3000


@pytest.fixture(scope="module")
def url():
    with serving(Path(FOLDER)) as address:
        yield address


@pytest.fixture(params=SIZES)
def page(request, url, tmp_path):
    browser = Chromium(BROWSER, tmp_path)
    width, height, ratio = SIZES[request.param]
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=False
    )
    open_page(browser, url)
    yield browser
    browser.close(tmp_path / "last.png")
    assert browser.errors == []


def open_page(browser, address):
    browser.call("Page.navigate", url="about:blank")
    browser.call("Page.navigate", url=address)
    browser.wait_for("globalThis.ballbot?.scene")


def part(page, name, scene="ballbot.scene"):
    return np.array(page.evaluate(f"[...{scene}.part(0, '{name}')]"))


def choose(page, control, value):
    page.evaluate(
        f"(e => {{ e.value = {json.dumps(value)}; e.dispatchEvent(new Event('change')); }})"
        f"(document.getElementById('{control}'))"
    )


@pytest.mark.parametrize("page", ["wide"], indirect=True)
def test_robots_move_as_in_the_core_under_every_law_and_policy(page):
    laws = page.evaluate("ballbot.simulator.catalog.controllers.map(({ name }) => name)")
    assert set(laws) < set(bb.controllers())
    policies = page.evaluate("Object.keys(ballbot.simulator.policies)")
    assert set(policies) == {path.stem for path in POLICIES.glob("*.onnx") if bb.OnnxPolicy(path).task in FOLLOWING}
    tried = [(robot, "contact", law) for law in laws for robot in ("paper", "kugle")] + [("rezero", "spatial", "lqr")]
    tried += [*(("paper", "contact", policy) for policy in policies), ("kugle", "contact", "balance-any")]
    differences = {}
    for robot, model, law in tried:
        settings = {"robot": robot, "model": model, "controller": law, "tilt": 0.05}
        row = page.evaluate(
            f"(() => {{ const scene = ballbot.simulator.open({json.dumps(settings)}); scene.advance({STEPS});"
            "const out = ['ball_position', 'ball_quaternion', 'body_position', 'body_quaternion', 'wheel_angles',"
            "'ball_velocity'].flatMap(name => [...scene.part(0, name)]); scene.close(); return out; })()"
        )
        is_policy = law in policies
        controller = (
            bb.OnnxPolicy(POLICIES / f"{law}.onnx").controller(robot) if is_policy else bb.make_controller(law, robot)
        )
        steps = round(1000.0 * controller.control_dt)
        core = bb.Ballbot(robot, model)
        core.reset(bb.State.at_rest(bb.Params.preset(robot), tilt=(0.05, 0.0)))
        for _ in range(STEPS // steps):
            core.step(controller(core.state), steps)
        core.step(controller(core.state), STEPS % steps)
        state = core.state
        same = (state.ball_position, state.ball_quaternion, state.body_position, state.body_quaternion)
        expected = np.concatenate([*same, state.wheel_angles, state.ball_velocity])
        differences[robot, model, law] = np.abs(row - expected).max()
    print(differences)
    # Sines and other functions are of another library, and round differently.
    assert max(differences.values()) < 1e-9


@pytest.mark.parametrize("page", ["wide"], indirect=True)
def test_a_course_is_followed_shared_and_left(page, url):
    choose(page, "course", "circle")
    page.evaluate("ballbot.pause(true); ballbot.scene.advance(8000)")
    assert np.linalg.norm(part(page, "ball_position")[:2] - part(page, "setpoint")) < 0.05
    assert np.linalg.norm(part(page, "ball_velocity")[:2]) > 0.15
    page.evaluate("ballbot.stop()")
    assert page.evaluate("document.getElementById('course').value") == "none"
    open_page(page, f"{url}#course=eight&controller=balance-any")
    page.evaluate("ballbot.pause(true); ballbot.scene.advance(8000)")
    assert np.linalg.norm(part(page, "ball_velocity")[:2]) > 0.1
    # A robot that drives by its velocity has no place on a course.
    choose(page, "controller", "velocity")
    assert page.evaluate("ballbot.choices.course") == "none"
    assert "drive it" in page.evaluate("document.getElementById('message').textContent")


def test_a_robot_is_pushed_driven_and_sent(page):
    page.click_until(lambda: part(page, "tilt")[0] > 0.005, "document.getElementById('push')")
    wait_until(lambda: part(page, "tilt")[0] < 0.01)
    page.evaluate("document.getElementById('scene').focus()")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW", windowsVirtualKeyCode=87)
    wait_until(lambda: part(page, "ball_velocity")[0] > 0.15)
    page.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW", windowsVirtualKeyCode=87)
    wait_until(lambda: abs(part(page, "ball_velocity")[0]) < 0.02)
    page.evaluate("ballbot.scenes().forEach(scene => scene.call('go_to', 0, 0))")
    wait_until(lambda: np.linalg.norm(part(page, "ball_position")[:2]) < 0.05)
    assert part(page, "fallen")[0] == 0.0


def test_a_click_on_the_floor_sends_the_robot_and_a_drag_of_the_robot_pulls_it(page):
    width, height = page.evaluate("[ballbot.view.parent.clientWidth, ballbot.view.parent.clientHeight]")
    page.click(0.15 * width, 0.8 * height)
    wait_until(lambda: np.linalg.norm(part(page, "setpoint")) > 0.1)
    page.evaluate("ballbot.scene.call('reset')")
    wait_until(lambda: part(page, "tilt")[0] < 0.002)
    middle = page.evaluate(
        "(p => [(p.x + 1) / 2 * ballbot.view.parent.clientWidth, (1 - p.y) / 2 * ballbot.view.parent.clientHeight])"
        "(ballbot.view.robots[0].body.position.clone().setZ(0.6 * ballbot.view.height).project(ballbot.view.camera))"
    )
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=middle[0], y=middle[1])
    page.call("Input.dispatchMouseEvent", type="mousePressed", x=middle[0], y=middle[1], button="left", clickCount=1)
    for i in range(1, 9):
        x = middle[0] + 0.02 * width * i
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=middle[1], button="left", buttons=1)
    wait_until(lambda: part(page, "tilt")[0] > 0.004)
    page.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=middle[1], button="left", clickCount=1)
    wait_until(lambda: part(page, "tilt")[0] < 0.004)


def test_a_link_restores_the_choices_and_a_wrong_one_is_named(page, url):
    choose(page, "robot", "kugle")
    choose(page, "controller", "cascade_pid")
    choose(page, "compare", "lqr")
    page.evaluate("(e => { e.value = 1.2; e.dispatchEvent(new Event('input')); })(document.getElementById('mass'))")
    page.evaluate("ballbot.view.camera.position.set(3, 2, 1)")
    page.click_until(lambda: "camera" in page.evaluate("location.hash"), "document.getElementById('share')")
    address = page.evaluate("location.href")
    open_page(page, address)
    chosen = page.evaluate("ballbot.choices")
    assert (chosen["robot"], chosen["controller"], chosen["compare"]) == ("kugle", "cascade_pid", "lqr")
    assert chosen["sliders"]["mass"] == 1.2
    assert page.evaluate("ballbot.ghost.part(0, 'fallen')[0]") == 0.0
    assert page.evaluate("ballbot.view.camera.position.length()") > 2.0
    for wrong in (
        "robot=nobody",
        "robots=1e9",
        "sliders.mass=nan",
        "terrain=%00",
        "camera=1,2",
        "model=rigid",
        "x.y.z=1",
        "__proto__.offset=1",
    ):
        open_page(page, f"{url}#{wrong}")
        assert page.evaluate("ballbot.choices.robot") == "paper"
        assert page.evaluate("ballbot.choices.robots") == 1
        assert page.evaluate("({}).offset") is None
        # spatial simulates only planes, and the model rigid is not in the page.
        message = page.evaluate("document.getElementById('message').textContent")
        assert wrong.partition("=")[0] in message


def test_choices_that_do_not_fit_together_leave_page_and_robots_as_they_were(page):
    choose(page, "robot", "rezero")
    choose(page, "terrain", "bumps")
    choose(page, "model", "spatial")
    assert "planes" in page.evaluate("document.getElementById('message').textContent")
    chosen = page.evaluate("[ballbot.choices.model, document.getElementById('model').value, ballbot.choices.terrain]")
    assert chosen == ["contact", "contact", "bumps"]
    patch = page.evaluate("ballbot.view.patch.uuid")
    choose(page, "terrain", "wave")
    page.wait_for(f"ballbot.view.patch && ballbot.view.patch.uuid !== {json.dumps(patch)}")
    page.evaluate("ballbot.each('go_to', 100, 0)")
    page.evaluate("ballbot.scene.advance(40000)")
    assert 2.0 < part(page, "ball_position")[0] < 10.0
    choose(page, "controller", "pid")
    page.evaluate("ballbot.each('go_to', 1, 0)")
    assert "holds the tilt" in page.evaluate("document.getElementById('message').textContent")


def test_the_plots_begin_again_with_the_robots(page):
    page.evaluate(
        "ballbot.pause(true); ballbot.scene.advance(30000); ballbot.plots.forEach(p => p.add(ballbot.scene.time))"
    )
    page.evaluate("ballbot.reset(); ballbot.plots.forEach(plot => plot.add(ballbot.scene.time))")
    assert page.evaluate("ballbot.plots.map(plot => plot.times.length)") == [1] * 4


def test_settings_that_do_not_fit_are_errors_and_the_robots_stay(page):
    for settings, words in (
        ({"robot": "nobody"}, "nobody"),
        ({"model": "rigid"}, "rigid"),
        ({"robots": 0}, "1 to 1000"),
        ({"params": {"body_mass": -1.0}}, "body_mass"),
        ({"options": {"torque": [1.0, 2.0]}}, "torque"),
        ({"unknown": 1}, "unknown"),
        ({"tilt": "much"}, "tilt"),
        ({"terrain": {"kind": "bumps", "slope": 9.0}}, "slope"),
    ):
        error = page.evaluate(
            f"(() => {{ try {{ ballbot.simulator.open({json.dumps(settings)}); return ''; }}"
            "catch (error) { return error.message; } })()"
        )
        assert words in error
    for call in (
        "advance(-1)",
        "advance(1.5)",
        "advance(1e9)",
        "part(7, 'tilt')",
        "part(0, 'nothing')",
        "heights(0, 0, 1, 1e9)",
    ):
        assert page.evaluate(f"(() => {{ try {{ ballbot.scene.{call}; }} catch (e) {{ return e.message; }} }})()")
    before = page.evaluate("ballbot.scene.time")
    wait_until(lambda: page.evaluate("ballbot.scene.time") > before)


@pytest.mark.parametrize("page", ["wide"], indirect=True)
def test_after_a_hundred_clicks_anywhere_no_robot_stays_fallen_and_memory_is_bounded(page):
    random = np.random.default_rng(0)
    memory = None
    for i in range(100):
        x, y = random.uniform((0.0, 0.0), (1000.0, 700.0))
        page.click(x, y)
        if random.uniform() < 0.2:
            choose(page, "robots", int(random.choice([1, 4, 16])))
        if i == 40:
            memory = page.evaluate("ballbot.simulator.exports.memory.buffer.byteLength")
    page.evaluate("ballbot.pause(false)")
    choose(page, "speed", 1)
    wait_until(lambda: page.evaluate("ballbot.scene.part(0, 'fallen')[0]") == 0.0)
    assert page.evaluate("ballbot.simulator.exports.memory.buffer.byteLength") <= memory + (4 << 20)


@pytest.mark.parametrize("page", ["wide"], indirect=True)
def test_pictures_leave_nothing_behind(page):
    page.call("Emulation.setDeviceMetricsOverride", width=160, height=120, deviceScaleFactor=0.5, mobile=False)
    choose(page, "compare", "cascade_pid")
    page.evaluate("ballbot.view.renderer.setAnimationLoop(null)")

    def used_after(pictures):
        page.evaluate(
            f"(() => {{ for (let i = 0; i < {pictures}; i++) {{ if (i % 40 === 0) ballbot.push();"
            "ballbot.picture(ballbot.last + 20); } })()"
        )
        page.call("HeapProfiler.collectGarbage")
        return page.call("Runtime.getHeapUsage")["usedSize"]

    # The plots have 10 s of numbers at most.
    before = used_after(550)
    assert used_after(550) < before + 200_000


@pytest.mark.parametrize("page", ["wide"], indirect=True)
def test_a_scene_out_of_sight_rests(page):
    page.evaluate("document.getElementById('scene').style.display = 'none'")
    time.sleep(0.3)
    before = page.evaluate("ballbot.scene.time")
    time.sleep(0.5)
    assert page.evaluate("ballbot.scene.time") == before
    page.evaluate("document.getElementById('scene').style.display = ''")
    wait_until(lambda: page.evaluate("ballbot.scene.time") > before)


def test_a_lost_view_is_named_and_comes_back(page):
    page.evaluate(
        "globalThis.lost = ballbot.view.renderer.getContext().getExtension('WEBGL_lose_context'); lost.loseContext()"
    )
    page.wait_for("/3D view/.test(document.getElementById('message').textContent)")
    before = page.evaluate("ballbot.scene.time")
    wait_until(lambda: page.evaluate("ballbot.scene.time") > before)
    page.evaluate("lost.restoreContext()")
    page.wait_for("document.getElementById('message').hidden")
    page.errors[:] = [error for error in page.errors if "Context Lost" not in error and "CONTEXT_LOST" not in error]


def test_nothing_is_wider_than_the_window_and_every_control_has_a_name(page):
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    controls = "[...document.querySelectorAll('button, select, input')]"
    unnamed = f"{controls}.filter(e => !e.labels?.length && !e.textContent.trim())"
    assert page.evaluate(f"{unnamed}.length") == 0


def test_the_files_are_small_enough():
    total = sum(len(gzip.compress(path.read_bytes(), 9)) for path in Path(FOLDER).iterdir())
    assert total < 3e6


def test_nothing_is_loaded_after_the_start(url, tmp_path):
    browser = Chromium(BROWSER, tmp_path)
    try:
        open_page(browser, url)
        time.sleep(1.0)
        names = browser.evaluate("performance.getEntriesByType('resource').map(e => new URL(e.name).origin)")
        assert set(names) == {url.rstrip("/")}
    finally:
        browser.close()
