"""`StateFeedback`: the torques of a gain, by named columns."""

import copy
import pickle

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.resolve import find

#: `Lqr` without what a gain does not have.
BARE = {"max_lean": 1e6, "max_speed": 1e6, "traction": False}


def motions(params, count=40):
    """States near the equilibrium, and setpoints."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        yaw = rng.uniform(-3.0, 3.0)
        state = bb.State.at_equilibrium(params, tilt=rng.uniform(-0.01, 0.01, 2), yaw=yaw).replace(
            ball_velocity=[*rng.uniform(-0.05, 0.05, 2), 0.0], body_angular_velocity=rng.uniform(-0.05, 0.05, 3)
        )
        parts = {name: rng.uniform(-0.05, 0.05, 2) for name in ("position", "velocity")}
        yield state, {**parts, "yaw": yaw + rng.uniform(-0.05, 0.05), "yaw_rate": rng.uniform(-0.05, 0.05)}


@pytest.mark.parametrize("robot", ["paper", "kugle", "rezero"])
def test_the_gain_of_lqr_gives_the_torques_of_lqr(robot):
    params = bb.Params.preset(robot).replace(max_wheel_torque=1e3)
    lqr = bb.Lqr(params, max_torque=1e3, **BARE)
    law = bb.StateFeedback(lqr.gain, robot=params)
    for state, setpoint in motions(params):
        np.testing.assert_allclose(law(state, **setpoint), lqr(state, **setpoint), rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(law(state), lqr(state), rtol=1e-10, atol=1e-12)


def test_it_takes_several_states():
    law = bb.StateFeedback(bb.Lqr().gain[:, [2, 3]], ["tilt x", "tilt y"])
    assert repr(law) == "<StateFeedback on tilt x, tilt y, control_dt=0.01 s>"
    states = [bb.State.at_rest("paper", (0.01 * i, 0.02)) for i in range(3)]
    expected = np.array([law(state, yaw=0.1) for state in states])
    np.testing.assert_array_equal(law(states, yaw=0.1), expected)
    np.testing.assert_array_equal(law(np.array([state.to_array() for state in states]), yaw=0.1), expected)
    np.testing.assert_array_equal(law(states[1].to_array(), yaw=0.1), expected[1])
    assert law([]).shape == (0, 3)


def test_columns_have_any_order_and_may_be_absent():
    gain = bb.Lqr().gain
    order = np.random.default_rng(2).permutation(10)
    names = [bb.LinearModel.STATES[i] for i in order]
    np.testing.assert_array_equal(bb.StateFeedback(gain[:, order], names).gain, gain)
    some = bb.StateFeedback(gain[:, [3, 8]], ["tilt y", "body rate y (rad/s)"]).gain
    np.testing.assert_array_equal(some[:, [3, 8]], gain[:, [3, 8]])
    assert not np.delete(some, [3, 8], axis=1).any()
    some[:] = 0.0
    np.testing.assert_array_equal(bb.StateFeedback(gain).gain, gain)


def test_it_is_a_law_of_the_robot_that_it_controls(tmp_path):
    # A robot whose equilibrium leans.
    params = bb.Params.preset("kugle").replace(body_com_offset=(0.01, 0.0))
    gain = bb.Lqr(params).gain
    law = bb.StateFeedback(gain)
    done = bb.simulate(law, robot=params, tilt=(0.03, 0.0))
    assert done.fell_at is None
    assert done.metrics().position_error_final < 0.01
    # The law of the paper's robot, which a call makes, is not copied.
    assert law(bb.State.at_rest(bb.Params.paper())).shape == (3,)
    for other in (copy.deepcopy(law), pickle.loads(pickle.dumps(law))):
        np.testing.assert_array_equal(bb.simulate(other, robot=params, tilt=(0.03, 0.0)).torques, done.torques)
    np.save(tmp_path / "gain.npy", gain)
    loaded = f"np.load({str(tmp_path / 'gain.npy')!r})"
    (tmp_path / "mine.py").write_text(
        f"import numpy as np\nimport ballbot_rs as bb\nlaw = bb.StateFeedback({loaded})\n"
    )
    named = bb.simulate(f"{tmp_path / 'mine.py'}:law", robot=params, tilt=(0.03, 0.0))
    np.testing.assert_array_equal(named.torques, done.torques)
    assert named.controller.endswith("mine.py:law")
    found = bb.evaluate(bb.StateFeedback(bb.Lqr().gain), task="velocity", episodes=3, max_episode_steps=500)
    assert (found.survival_rate, found.control_dt) == (1.0, 0.01)
    assert find(bb.StateFeedback(gain, control_dt=0.002)).control_dt == 0.002


@pytest.mark.parametrize(
    ("gain", "arguments", "message"),
    [
        (np.ones((3, 9)), {}, r"gain has shape \(3, 9\), expected \(3, 10\): one column per state"),
        (np.ones((10, 3)), {}, r"gain has shape \(10, 3\), expected \(3, 10\)"),
        (np.full((3, 10), np.nan), {}, "gain has numbers that are not finite"),
        (np.ones((3, 1)), {"states": ["tilt z"]}, "unknown state 'tilt z': expected one of x, y, .*did you mean 'tilt"),
        (np.ones((3, 2)), {"states": ["x", "x (m)"]}, r"the state 'x \(m\)' has two columns"),
        (np.ones((3, 1)), {"states": "x"}, "states = 'x': expected a list of names"),
        (np.ones((3, 10)), {"control_dt": 0.0}, "control_dt = 0.0 is out of range: it must be above 0"),
        (np.ones((3, 10)), {"robot": "kugel"}, "kugel"),
        (np.ones((3, 10)), {"states": 10}, "states = 10: expected a list of names"),
        (np.broadcast_to(0.0, 10**12), {}, r"gain has shape \(1000000000000,\), expected \(3, 10\)"),
    ],
)
def test_bad_input_is_named(gain, arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.StateFeedback(gain, **arguments)
