"""The sensitivities of the page: of its robot, controller and push, computed next to the simulation."""

import math
import re

import numpy as np
import pytest

from ballbot_rs import Lqr, Params, Terrain
from ballbot_rs.analysis import sensitivity as analysis
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.sensitivity import collect
from ballbot_rs.control.resolve import find
from ballbot_rs.viewer.session import sensitivity
from ballbot_rs.viewer.session.sensitivity import PUSH_DURATION, SECONDS, Sensitivities
from ballbot_rs.viewer.session.session import Session
from tests.support.onnx_policies import SHIPPED
from tests.support.waiting import wait_until
from tests.viewer.test_viewer_session import run


def computed(session, impulse=0.3, direction=0.0):
    """The sensitivities of a session, which simulates meanwhile."""
    sensitivities = Sensitivities()
    sensitivities.start(session, direction, impulse)

    def has_ended():
        session.step()
        sensitivities.update()
        return sensitivities.progress is None

    wait_until(has_ended)
    return sensitivities


LQR = Lqr(Params.paper(), 0.01)


class Remembering:
    """LQR as an object in Python with a memory."""

    calls = 0

    def __call__(self, state):
        self.calls += 1
        return LQR(state)

    def reset(self):
        self.calls = 0


def test_they_are_of_the_robot_controller_and_push_of_the_page():
    session = Session("spatial", "kugle")
    found = computed(session, 0.4, math.pi / 2).found
    push = Push((0.0, 0.4, 0.0), 0.0, PUSH_DURATION)
    options = {"robot": "kugle", "model": "spatial"}
    expected = collect("lqr", tilt=(0.0, 0.0), pushes=push, seconds=SECONDS, env_options=options)
    assert found.names == expected.names
    for name, effects in expected.effects.items():
        np.testing.assert_allclose(found.effects[name], effects, rtol=1e-6, atol=1e-6 * effects.max())


def test_the_controller_is_made_for_the_nominal_robot_and_the_parameters_are_the_changed_ones():
    session = Session()
    session.change(body_mass=1.3, com_x=2.0)
    sensitivities = computed(session)
    assert "paper as changed" in sensitivities.conditions
    changed = session.robots[0].params
    found = sensitivities.found
    assert found.values[found.names.index("body_mass")] == changed.body_mass
    assert found.values[found.names.index("body_com_offset_x")] == changed.body_com_offset[0]
    # A controller that knows the added mass would hold the robot another way.
    push = Push((0.3, 0.0, 0.0), 0.0, PUSH_DURATION)
    knowing = collect("lqr", tilt=(0.0, 0.0), pushes=push, seconds=SECONDS, env_options={"robot": changed})
    assert not np.allclose(found.effects["ball"], knowing.effects["ball"], rtol=0.05)


def test_the_task_and_its_ground_are_as_on_the_page():
    waves = Terrain.generate("wave", size_x=6.0, size_y=6.0)
    hilly, level = (computed(Session(task="goal", task_options=options)) for options in ({"terrain": waves}, {}))
    assert "task goal:" in hilly.conditions
    assert not np.allclose(hilly.found.effects["ball"], level.found.effects["ball"], rtol=0.1)


def test_a_policy_has_them():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    sensitivities = computed(Session(controller=str(SHIPPED)))
    assert sensitivities.conditions.startswith(f"{SHIPPED.name} on paper")
    assert sensitivities.found.largest(1).names == ("body_mass",)


def test_a_law_in_python_has_them_and_keeps_its_memory():
    law = Remembering()
    session = Session(controller=find(law))
    run(session, 0.5)
    before = law.calls
    sensitivities = computed(session)
    assert sensitivities.error == ""
    expected = computed(Session()).found
    assert np.allclose(sensitivities.found.effects["ball"], expected.effects["ball"], rtol=1e-3, atol=1e-3)
    # Only the calls of the simulation, one a step.
    assert law.calls - before == round(session.time / 0.01) - 50


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"controller": "zero"}, "a robot falls at .* s: sensitivities need a motion that stays upright"),
        ({"observation": "sensors"}, "leave out events and sensors"),
        ({"events": "mild"}, "leave out events and sensors"),
    ],
)
def test_an_error_is_in_words_and_the_simulation_continues(options, error):
    session = Session(**options)
    sensitivities = computed(session)
    assert sensitivities.found is None
    assert re.search(error, sensitivities.error)
    assert session.time > 0.0


def test_an_object_that_cannot_be_copied_is_an_error_in_words():
    sensitivities = Sensitivities()
    sensitivities.start(Session(controller=find(LQR)), 0.0, 0.3)
    assert sensitivities.progress is None
    assert sensitivities.error.startswith("lqr cannot be copied: ")


def test_a_slow_controller_is_computed_next_to_the_simulation_until_it_is_stopped(monkeypatch):
    monkeypatch.setattr(analysis, "CHUNK", 1)
    session, sensitivities = Session(controller="nmpc"), Sensitivities()
    sensitivities.start(session, 0.0, 0.3)
    job = sensitivities._computing.job
    wait_until(lambda: sensitivities.progress > 0.0)
    session.step()
    sensitivities.stop()
    assert sensitivities.progress is None
    wait_until(job.done.is_set)
    assert isinstance(job.error, InterruptedError)
    sensitivities.update()
    assert (sensitivities.found, sensitivities.error) == (None, "")


def test_a_computation_has_a_time_limit(monkeypatch):
    monkeypatch.setattr(sensitivity, "MAX_SECONDS", 0.0)
    monkeypatch.setattr(analysis, "CHUNK", 1)
    session, sensitivities = Session(controller="nmpc"), Sensitivities()
    sensitivities.start(session, 0.0, 0.3)
    job = sensitivities._computing.job
    wait_until(lambda: (sensitivities.update(), sensitivities.progress is None)[1])
    assert sensitivities.error.endswith("it took longer than 0 s")
    wait_until(job.done.is_set)


def test_the_table_has_three_digits_and_begins_with_the_largest():
    pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")
    from ballbot_rs.viewer.panels.sensitivity import digits, table_of

    assert [digits(x) for x in (0.0, 5.3, 617.9, 0.00071, 12.0, 3.2e-6, 41234.0)] == [
        "0",
        "5.30",
        "618",
        "0.000710",
        "12.0",
        "3.20e-06",
        "4.12e+04",
    ]
    found = collect("lqr", ("body_mass", "wheel_mass"), seconds=1.0)
    table = table_of(found)
    assert table.index("body_<wbr>mass") < table.index("wheel_<wbr>mass")
    assert "2.23 + 0.223 kg" in table
    for name, effects in found.effects.items():
        assert f">{digits(effects[0])}</td>" in table, name
