"""Results at a prompt and in a notebook: short, with what counts."""

import dataclasses
import html.parser

import numpy as np
import pytest

import ballbot_rs as bb


class Tags(html.parser.HTMLParser):
    """The cells of a fragment, whose tags must match."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells = [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):  # noqa: ARG002
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells.append(data)


@pytest.fixture(scope="module")
def results():
    return bb.compare(["lqr", "pid"], episodes=4)


def test_a_result_is_one_line(results):
    lqr, pid = map(repr, results)
    assert lqr.startswith("<Result of lqr on contact: 4 episodes, success 100%, upright 100%, mean reward 0.9")
    assert len(lqr) <= 100
    assert f"success {results[1].success_rate:.0%}" in pid


def test_a_result_in_a_notebook_has_its_numbers(results):
    cells = Tags(results[0]._repr_html_()).cells
    for name, value in (("success rate", "1"), ("tilt rms", f"{results[0].tilt_rms:.4g}")):
        assert cells[cells.index(name) + 1] == value
    changed = dataclasses.replace(results[0], controller="<b>", metrics={"cost": 0.25})
    cells = Tags(changed._repr_html_()).cells
    assert cells[cells.index("controller") + 1] == "<b>"
    assert cells[cells.index("cost") + 1] == "0.25"


def test_metrics_have_four_digits():
    metrics = bb.simulate("lqr", tilt=(0.05, 0.0), seconds=0.5).metrics()
    assert f"tilt_max={metrics.tilt_max:.4g}," in repr(metrics)
    assert eval(repr(metrics), {"Metrics": bb.Metrics}).torque_rms == pytest.approx(metrics.torque_rms, rel=1e-3)
    cells = Tags(metrics._repr_html_()).cells
    assert cells[cells.index("tilt, largest") + 1] == f"{np.degrees(metrics.tilt_max):.4g} deg"


def test_an_outcome_and_a_scale_are_one_line():
    (outcome,) = bb.run_scenarios(["lqr"], ["S4"])
    assert repr(outcome) == f"<Outcome of lqr in S4: largest_error {outcome.score:.4g}, 4 of 4 successes>"
    scale = bb.Scale.of(bb.Params.paper())
    assert repr(scale).startswith(f"Scale(toppling_rate={scale.toppling_rate:.4g}, ")


def test_a_tuned_controller_is_one_line():
    tuned = bb.Tuned("lqr", {"position": 0.123456, "tilt": 2.0}, 0.56789, [1.0] * 200)
    assert repr(tuned) == "<Tuned lqr: cost 0.5679 after 200 evaluations, position=0.1235, tilt=2>"


def test_the_repr_of_a_controller_describes_it():
    info = bb.controllers()["lqr"]
    assert repr(info) == f"<ControllerInfo lqr: {info.summary}>"
    cells = Tags(info._repr_html_()).cells
    assert cells[cells.index("position") + 1] == "0.15"
    assert cells[cells.index("position") + 3] == ">= 1e-6 and <= 1e6"


def test_a_state_is_one_line_and_a_table(paper):
    state = bb.State.at_rest(paper, tilt=(0.1, 0.0), yaw=0.5)
    assert repr(state) == "<State: ball at (0, 0) m, 0 m/s, tilt 5.73 deg, yaw 28.65 deg, wheels (0, 0, 0) rad/s>"
    cells = Tags(state._repr_html_()).cells
    assert cells[:3] == ["ball_position", "0, 0, 0.112", "m"]
    assert "body_velocity" in cells
    tiny = state.replace(ball_velocity=(1.5e-7, 0.0, 0.0), wheel_speeds=(123456.0, 1234.56, -0.00001))
    assert "1.500e-7 m/s" in repr(tiny)
    assert "(1.235e5, 1235, -1.000e-5)" in repr(tiny)
    contacts = bb.Ballbot().contacts
    assert Tags(contacts._repr_html_()).cells[0] == "wheel_normal_forces"


def test_a_misspelt_name_suggests_the_closest_known_name(paper):
    with pytest.raises(TypeError, match="did you mean 'position'"):
        bb.Lqr(paper, positon=0.1)
    with pytest.raises(ValueError, match="did you mean 'cascade_pid'"):
        bb.Controller("cascade_pdi", paper, 0.01)
    batch = bb.Batch(1)
    batch.reset()
    with pytest.raises(ValueError, match="did you mean 'states'"):
        batch.rollout(bb.Lqr(batch.params(0), batch.control_dt), 1, record=["state"])
    with pytest.raises(TypeError) as error:
        bb.Lqr(paper, zzz=0.1)
    assert "did you mean" not in str(error.value)
