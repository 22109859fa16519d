"""`bb.show`: a program commands and observes the robots on a page."""

import importlib.util
import itertools
import urllib.request

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

import ballbot_rs as bb
from ballbot_rs.viewer.session import Session
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow("real time")


@pytest.fixture
def page():
    with bb.show("lqr", task="velocity", num_robots=2, port=18990) as page:
        yield page
    assert page._view.runner.error is None


def test_a_program_drives_observes_and_records(page):
    with urllib.request.urlopen(page.url, timeout=10) as answer:
        assert answer.status == 200
    page.record()
    page.command(0.3, 0.1, yaw_rate=-0.2)
    page.push((0.02, 0.01))
    pushed = page.time
    page.wait(3.0)
    assert page.time >= 3.0
    assert page.states.shape == (2, 32)
    assert page.torques.shape == (2, 3)
    yaw = page.state.yaw
    forward, left = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ page.state.ball_velocity[:2]
    assert (forward, left) == pytest.approx((0.3, 0.1), abs=0.03)
    assert set(page.metrics) == {"velocity_error", "yaw_rate_error"}
    done = page.recorded()
    assert done.times[-1] == pytest.approx(3.0, abs=0.5)
    assert (done.model, done.task, done.sim_dt) == ("contact", "velocity", 0.002)
    np.testing.assert_allclose(done.commands[-1], (0.3, 0.1, -0.2))
    assert len(done.commands) == len(done.times)
    [push] = done.pushes
    assert push.impulse == pytest.approx((0.02, 0.01, 0.0))
    assert push.time == pytest.approx(pushed - page.time + done.times[-1], abs=0.5)
    page.command(0.0)
    page.wait(3.0)
    assert np.abs(page.states[:, 7:9]).max() < 0.2
    assert f'src="{page.url}"' in page._repr_html_()


def test_a_tab_has_elements_of_the_program(page):
    with page.add_tab("Mine"):
        slider = page.gui.add_slider("Gain", min=0.0, max=1.0, step=0.1, initial_value=0.5)
    assert slider.value == 0.5
    assert slider._impl.parent_container_id != page.gui.add_text("Below", "")._impl.parent_container_id


def test_pushes_parameters_and_choices_act(page):
    page.reset((0.0, 0.0))
    page.push((0.0, 0.3))
    page.wait(0.1)
    assert (
        page.states[:, 8].min() > 0.01 or np.abs([bb.State.from_array(row).tilt for row in page.states]).min() > 0.005
    )
    heavy = page.params.replace(body_mass=2.0 * page.params.body_mass)
    page.set_params(heavy)
    page.wait(0.05)
    assert page.params.body_mass == heavy.body_mass
    page.choose(controller="lqi", task="balance")
    page.go_to(0.2, 0.0)
    page.wait(0.05)
    # Of the robot that is simulated, not of its controller.
    assert page.params.body_mass == heavy.body_mass
    page.choose(robot="kugle")
    page.wait(0.05)
    assert page.params == bb.Params.preset("kugle")
    assert page.time < 1.0


def test_errors_reach_the_program_and_change_nothing(page):
    for call, message in (
        (lambda: page.command(0.6), r"vx = 0.6 is out of range: expected -0.5 to 0.5"),
        (lambda: page.command(0.4, 0.4), r"the speed of \(0.4, 0.4\) m/s is out of range: expected at most 0.5"),
        (lambda: page.command(0.0, yaw_rate=np.nan), r"yaw_rate = nan"),
        (lambda: page.go_to(1.0, 0.0), "a click is not a command of the task velocity"),
        (lambda: page.push((1.0, 0.0, 0.0)), r"impulse has shape \(3,\), expected \(2,\)"),
        (lambda: page.push((1001.0, 0.0)), "impulse = 1001.0 is out of range"),
        (lambda: page.choose(model="spherical"), "unknown model 'spherical'"),
        (lambda: page.set_params({"body_mass": 3.0}), "parameters ball_mass, .* are missing"),
        (lambda: page.recorded(), "nothing has been recorded: call record before"),
        (lambda: page.wait(-1.0), "seconds = -1.0 is out of range"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    for call, message in (
        (lambda: page.set_params(3.0), "robot must be Params, the name of a preset, .* not float"),
        (lambda: page.set_params(None), "params must name a robot, not None"),
        (lambda: page.reset(np.ma.masked_all(2)), "tilt is a masked array: expected two components"),
        (lambda: page.reset("0.1"), "tilt is '0.1': expected two components"),
        (lambda: page.choose(controler="lqi"), r"choose\(\) got an unexpected keyword.*did you mean 'controller'"),
    ):
        with pytest.raises(TypeError, match=message):
            call()
    with pytest.raises(ValueError, match=r"impulse has shape \(1000000000000,\), expected \(2,\)"):
        page.push(np.broadcast_to(0.0, 10**12))
    assert page.is_running
    with pytest.raises(ValueError, match="the page shows one kind of robot"):
        bb.show(robot={"family": 2})
    with pytest.raises(ValueError, match="the task balance is not driven"):
        Session().command(0.1, 0.0, 0.0)
    page.close()
    page.close()
    assert not page.is_running
    for call in (lambda: page.command(0.0), lambda: page.wait(1.0)):
        with pytest.raises(RuntimeError, match="the page is closed"):
            call()


def test_a_page_that_is_paused_ends_a_wait(page, monkeypatch):
    monkeypatch.setattr("ballbot_rs.viewer.show.WAIT", 0.2)
    monkeypatch.setattr("ballbot_rs.viewer.show.WAIT_PER_SECOND", 0.0)
    page._in_session(lambda session: setattr(session, "paused", True))
    with pytest.raises(TimeoutError, match=r"waited 0.2 s for 1 s of simulated time"):
        page.wait(1.0)


def test_a_joystick_bridge_takes_any_source(page):
    spec = importlib.util.spec_from_file_location("joystick", ROOT / "examples" / "joystick.py")
    joystick = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(joystick)
    commands = []
    command = page.command
    page.command = lambda *parts, **named: (commands.append((*parts, *named.values())), command(*parts, **named))
    joystick.drive(page, itertools.chain([(1.0, 1.0, -0.5)], [(0.0, 0.5, 0.0)]))
    expected = [(0.4 / np.sqrt(2), 0.4 / np.sqrt(2), -0.5), (0.0, 0.2, 0.0), (0.0,)]
    assert [pytest.approx(one) for one in expected] == commands
