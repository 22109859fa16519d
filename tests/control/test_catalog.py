"""The list of controllers, and a controller by its name, called with a setpoint."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.resolve import NAMES
from ballbot_rs.media.figures.labels import short

STATE = bb.State.at_rest(bb.Params.paper(), tilt=(0.03, -0.02))


@pytest.mark.parametrize("name", bb.controllers())
def test_the_listed_properties_match_the_controller(name):
    info = bb.controllers()[name]
    made = bb.make_controller(name)
    assert made.name == info.name == name
    assert tuple(made.setpoint_parts) == info.setpoint_parts
    assert made.control_dt == (info.control_dt or 0.01)
    defaults = {option: value.default for option, value in info.options.items()}
    same = bb.make_controller(name, None, info.control_dt, traction=info.traction or False, **defaults)
    np.testing.assert_array_equal(same(STATE), made(STATE))
    text = str(info)
    assert info.summary in text
    assert all(option in text for option in info.options)


def test_a_controller_is_of_its_robot_rate_and_gains():
    made = (("paper", 0.01, 0.15), ("kugle", 0.01, 0.15), ("paper", 0.002, 0.15), ("paper", 0.01, 0.3))
    torques = [
        bb.make_controller("lqr", params, control_dt, position=position)(STATE, position=(0.05, 0.0)).tolist()
        for params, control_dt, position in made
    ]
    assert len({tuple(row) for row in torques}) == 4
    with pytest.raises(ValueError, match="did you mean 'lqr'"):
        bb.make_controller("lqrr")
    with pytest.raises(TypeError, match="unexpected keyword argument 'weight'"):
        bb.make_controller("lqr", weight=1.0)
    with pytest.raises(TypeError, match="'positon': did you mean 'position'"):
        bb.make_controller("lqr", positon=1.0)


def test_scaled_options_are_of_the_papers_robot():
    rezero = bb.Params.preset("rezero")
    scaled = {"position": 0.2, "velocity": 0.5, "tilt_rate": 0.3}
    units = {"position": "m", "velocity": "m/s", "tilt_rate": "rad/s"}
    own = {name: value * rezero.scale(units[name]) for name, value in scaled.items()}
    law, same = bb.make_controller("lqr", rezero, tilt=0.2, scaled=scaled), bb.Lqr(rezero, tilt=0.2, **own)
    np.testing.assert_array_equal(law(STATE, position=(0.1, 0.0)), same(STATE, position=(0.1, 0.0)))
    # Of each robot of a batch, too.
    batch = bb.Batch(16, robot=["paper", rezero], num_threads=1)
    batch.reset()
    of_all = batch.control(bb.Controller("lqr", scaled=scaled), drawn=True)[8]
    of_one = bb.Controller("lqr", rezero, scaled=scaled, max_torque=batch.action_torques[8])(batch.state(8))
    np.testing.assert_allclose(of_all, of_one / batch.action_torques[8], atol=2e-6)


def test_scaled_options_are_checked():
    with pytest.raises(TypeError, match="'positon': did you mean 'position'"):
        bb.Controller("lqr", scaled={"positon": 0.2})
    with pytest.raises(TypeError, match="position is given twice"):
        bb.Controller("lqr", scaled={"position": 0.2}, position=0.2)
    with pytest.raises(ValueError, match="position = 0 is out of range"):
        bb.Controller("lqr", scaled={"position": 0.0})
    with pytest.raises(ValueError, match=r"scaled: horizon \(unit ''\) does not scale"):
        bb.Controller("mpc", scaled={"horizon": 20})
    with pytest.raises(ValueError, match="scaled: delay"):
        bb.Controller("lqr", scaled={"delay": 0.01})


def test_a_setpoint_is_a_mapping_or_keywords():
    law, reference = bb.Lqr(), bb.Reference.circle(0.3, 6.0)
    parts = reference(2.0)
    np.testing.assert_array_equal(law(STATE, parts), law(STATE, **parts))
    np.testing.assert_array_equal(law(STATE, bb.Setpoint(**parts)), law(STATE, **parts))
    np.testing.assert_array_equal(law(STATE, {}), law(STATE))
    np.testing.assert_array_equal(law(STATE, None), law(STATE))
    assert not np.array_equal(law(STATE, parts), law(STATE))


def test_parts_that_a_controller_does_not_follow_are_left_out_only_of_a_mapping():
    law, parts = bb.Pid(), {"tilt": (0.01, 0.0), "position": (1.0, 0.0)}
    np.testing.assert_array_equal(law(STATE, parts), bb.Pid()(STATE, tilt=(0.01, 0.0)))
    with pytest.raises(TypeError, match="follows no part of this setpoint: it follows tilt"):
        law(STATE, {"position": (1.0, 0.0)})
    with pytest.raises(TypeError, match="position"):
        law(STATE, position=(1.0, 0.0))
    for setpoint, message in (
        ({"place": (0, 0)}, "a setpoint has no part 'place'"),
        ([0.0, 0.0], "setpoint must be a mapping of parts by name, not list"),
    ):
        with pytest.raises(TypeError, match=message):
            bb.Lqr()(STATE, setpoint)
    with pytest.raises(TypeError, match="not both"):
        bb.Lqr()(STATE, {"yaw": 0.1}, position=(0.0, 0.0))
    with pytest.raises(ValueError, match="yaw"):
        bb.Lqr()(STATE, {"yaw": float("nan")})


def test_every_controller_has_a_unique_short_label():
    labels = [short(name) for name in NAMES]
    assert labels[:2] == ["LQR", "PID"]
    assert labels[-1] == "no torque"
    assert len(set(labels)) == len(labels)
    assert max(map(len, labels)) <= 21
