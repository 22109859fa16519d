"""Controllers as C99: equal to ours over all kinds of states, for robots of all kinds."""

import re
import subprocess

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import CONTROLLERS
from ballbot_rs.deployment import CONTROLLERS_IN_C, controller_header
from tests.support.c_code import PLACES, STRICT, CController, own_torques, random_setpoints, random_states, unit

#: What the C is promised to differ by at most, N·m; it differs by rounding.
TOLERANCE = 1e-6
#: In single precision; docs/deployment.md has what was measured.
FLOAT_TOLERANCE = 1e-4
STATES = 1000

UNEVEN = bb.Params.paper().replace(
    body_com_offset=(5e-3, -3e-3), wheel_azimuths=(0.02, 2.0 * np.pi / 3.0 - 0.03, 4.0 * np.pi / 3.0 + 0.01)
)
PRESETS = {name: bb.Params.preset(name) for name in ("paper", "kugle", "rezero", "asroballet")}
ROBOTS = {**PRESETS, "uneven": UNEVEN, "inclined": UNEVEN.replace(roller_angle=0.6)}


def slips(params, states):
    """Whether a wheel of each state slips, by the bound of the limits."""
    found = bb.Controller("lqr", params).constants()
    slipping = []
    for state in states:
        w, v = state.body_quaternion[0], -state.body_quaternion[1:]
        rate = state.ball_angular_velocity
        cross = 2.0 * np.cross(v, rate)
        relative = rate + w * cross + np.cross(v, cross) - state.body_angular_velocity
        slip = found["surface"] @ relative - found["wheel_radius"] * state.wheel_speeds
        slipping.append(np.abs(slip).max() > found["slipping"])
    return np.array(slipping)


@pytest.mark.slow("compiles C for each robot")
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", CONTROLLERS_IN_C)
def test_a_controller_in_c_computes_our_torques(name, robot, tmp_path):
    params = ROBOTS[robot]
    rng = np.random.default_rng(1)
    states = random_states(params, rng, STATES)
    setpoints = random_setpoints(states, rng)
    assert 0.1 < slips(params, states).mean() < 0.5
    left_alone = False
    for options in ({}, {"traction": False}, {"traction": 0.5, "max_torque": 0.3 * params.max_wheel_torque}):
        header = controller_header(name, params, **options)
        expected = own_torques(bb.Controller(name, params, **options), states, setpoints)
        torques, shares = CController(tmp_path, header).torques(states, setpoints)
        assert np.abs(torques - expected).max() < TOLERANCE, options
        single, _ = CController(tmp_path, header, "float").torques(states, setpoints)
        differences = [np.abs(found - expected).max() for found in (torques, single)]
        print("{} of {}: double {:.1e} N·m, float {:.1e} N·m".format(name, robot, *differences))
        assert np.abs(single - expected).max() < FLOAT_TOLERANCE, options
        # Limits act in many of the states.
        assert (shares[:, 0] < 1.0).mean() > 0.1, options
        left_alone |= bool((shares == 1.0).all(1).any())
    # They do not change others; `pid` differentiates jumps from state to state, `lqr_pi` tracks wheel rates that jump.
    assert name in ("pid", "lqr_pi") or left_alone


@pytest.mark.slow("compiles C for each robot")
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", CONTROLLERS_IN_C)
def test_a_control_barrier_in_c_changes_the_torques_as_ours(name, robot, tmp_path):
    params = ROBOTS[robot]
    rng = np.random.default_rng(2)
    states = random_states(params, rng, STATES)
    setpoints = random_setpoints(states, rng)
    speed, length = 0.2 * params.scale("m/s"), 0.5 * params.scale("m")
    boundary = [-0.8 * length, length, -0.6 * length, 0.6 * length]
    free = own_torques(bb.Controller(name, params), states, setpoints)
    for options in ({"speed_limit": speed}, {"boundary": boundary}, {"speed_limit": speed, "boundary": boundary}):
        header = controller_header(name, params, **options)
        expected = own_torques(bb.Controller(name, params, **options), states, setpoints)
        assert (np.abs(expected - free).max(1) > 1e-3 * np.abs(free).max()).sum() > 3, options
        double, single = (
            np.abs(CController(tmp_path, header, real).torques(states, setpoints)[0] - expected).max()
            for real in ("double", "float")
        )
        print(f"barrier, {name} of {robot}, {', '.join(options)}: double {double:.1e} N·m, float {single:.1e} N·m")
        assert double < TOLERANCE, options


@pytest.mark.slow("compiles C for each robot")
@pytest.mark.parametrize("robot", bb.Params.preset_names())
def test_limits_hold_alike_in_single_precision(robot, tmp_path):
    """In states beyond a limit rounding decides between torques that are all allowed."""
    params = bb.Params.preset(robot)
    speed, length = 0.15 * params.scale("m/s"), 0.8 * params.scale("m")
    header = controller_header("lqr", params, speed_limit=speed, boundary=[-length, length, -length, length])

    def farthest(real):
        in_c = CController(tmp_path, header, real)
        in_c.reset()

        def law(state, position):
            row = np.zeros((1, 14))
            row[0, :2] = position
            return in_c.torques([state], row)[0][0]

        motion = bb.simulate(law, robot=params, reference={"position": (5 * length, 2 * length)}, seconds=20.0)
        states = motion.to_array()
        return [np.hypot(*states[:, 7:9].T).max() / speed, *np.abs(states[:, :2]).max(0) / length]

    double, single = farthest("double"), farthest("float")
    print(f"barrier, {robot}: largest speed and places over their limits {np.round(double, 4)}, {np.round(single, 4)}")
    np.testing.assert_allclose(single, double, atol=1e-3)
    assert double[0] < 1.04


@pytest.mark.parametrize("robot", ["kugle", "uneven"])
@pytest.mark.parametrize("name", CONTROLLERS_IN_C)
def test_a_closed_loop_under_c_equals_ours(name, robot, tmp_path):
    """Two seconds, in which integrals and filters act."""
    params = ROBOTS[robot]
    law = bb.Controller(name, params)
    in_c = CController(tmp_path, controller_header(name, params))
    body = bb.Ballbot(params, model="contact", sim_dt=0.001)
    body.reset(bb.State.at_equilibrium(params, tilt=(0.01, -0.008), yaw=0.3))
    setpoint = {"position": (0.02, -0.01), "velocity": (0.0, 0.0), "yaw": 0.2, "tilt": (0.001, 0.0)}
    setpoint |= {"acceleration": (0.02, 0.0), "jerk": (0.0, 0.01), "snap": (0.01, 0.0), "yaw_rate": 0.05}
    row = np.zeros(14)
    for part, value in setpoint.items():
        row[PLACES[part]] = value
    given = {part: setpoint[part] for part in law.setpoint_parts}
    free = 0
    for _ in range(round(2.0 / law.control_dt)):
        (torques,), (shares,) = in_c.torques([body.state], [row])
        np.testing.assert_allclose(torques, law(body.state, **given), atol=TOLERANCE, rtol=0)
        free += shares[0] == 1.0
        body.step(torques, round(law.control_dt / 0.001))
    assert free > 100


def test_memory_is_forgotten_by_a_reset(tmp_path):
    rng = np.random.default_rng(2)
    states = [bb.State.at_equilibrium(UNEVEN, tilt=rng.normal(0.0, 0.003, 2)) for _ in range(50)]
    setpoints = np.zeros((50, 14))
    setpoints[:, 0] = 0.05
    for name in ("lqi", "cascade_pid", "pid"):
        in_c = CController(tmp_path, controller_header(name, UNEVEN, max_torque=5.0))
        first, _ = in_c.torques(states, setpoints)
        again, _ = in_c.torques(states, setpoints)
        assert np.abs(again - first).max() > 1e-4, name
        in_c.reset()
        np.testing.assert_array_equal(in_c.torques(states, setpoints)[0], first)


def test_the_torque_of_an_environment_is_an_additional_limit(tmp_path):
    rng = np.random.default_rng(3)
    states = random_states(UNEVEN, rng, 300)
    setpoints = random_setpoints(states, rng)
    own = bb.Controller("pid", UNEVEN).constants()["max_torque"]
    for given, expected in ((0.1, 0.1), (4.0, own)):
        header = controller_header("pid", UNEVEN, max_wheel_torque=given)
        torques, _ = CController(tmp_path, header).torques(states, setpoints)
        assert np.abs(torques).max() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_ball_is_found_from_wheels_that_grip(robot, tmp_path):
    params = ROBOTS[robot]
    in_c = CController(tmp_path, controller_header("lqr", params))
    rng = np.random.default_rng(4)
    for _ in range(50):
        state = bb.State.rolling(params, rng.normal(size=2), unit(rng.normal(size=4)), rng.normal(size=3), rng.normal())
        rate, velocity = in_c.rolled(state)
        np.testing.assert_allclose(rate, state.ball_angular_velocity, atol=1e-9)
        np.testing.assert_allclose(velocity, state.ball_velocity[:2], atol=1e-9)


def test_nan_is_propagated_and_not_hidden(tmp_path):
    state = bb.State.at_rest(UNEVEN, tilt=(0.01, 0.0))
    for name in CONTROLLERS_IN_C:
        for traction in (True, False):
            in_c = CController(tmp_path, controller_header(name, UNEVEN, traction=traction))
            setpoint = np.zeros(14)
            assert np.isfinite(in_c.torques([state], [setpoint])[0]).all()
            setpoint[[0, 5]] = np.nan
            assert np.isnan(in_c.torques([state], [setpoint])[0]).any(), name


def test_controllers_without_constants_are_rejected_by_name():
    assert set(CONTROLLERS_IN_C) <= set(CONTROLLERS)
    for name in set(CONTROLLERS) - set(CONTROLLERS_IN_C):
        with pytest.raises(ValueError, match="does not give its constants"):
            bb.Controller(name).constants()
        with pytest.raises(ValueError, match=f"'{name}' cannot be written as C: expected one of"):
            controller_header(name)


def test_a_header_needs_only_math_and_describes_itself():
    for name in CONTROLLERS_IN_C:
        text = controller_header(name, "kugle", 0.004, max_torque=1.5)
        assert set(re.findall(r"^#include (.*)", text, flags=re.MULTILINE)) == {"<math.h>"}
        assert text.isascii()
        assert bb.__version__ in text
        assert "robot 'kugle'" in text
        assert "BALLBOT_CONTROL_DT = 0.004 s" in text
        assert "max_torque = 1.5" in text
        names = re.findall(r"^(?:static inline \w+|static const \w+|#define) \*?(\w+)", text, flags=re.MULTILINE)
        assert len(names) > 30
        assert [known for known in names if not known.lower().startswith("ballbot_")] == []


def test_two_controllers_in_one_file_are_an_error_and_the_same_header_twice_is_not(tmp_path):
    for name, dt in (("a", 0.01), ("b", 0.02)):
        (tmp_path / f"{name}.h").write_text(controller_header("lqr", control_dt=dt), encoding="ascii")
    codes = {"once": '#include "a.h"\n', "twice": '#include "a.h"\n' * 2, "both": '#include "a.h"\n#include "b.h"\n'}
    errors = {}
    for name, code in codes.items():
        (tmp_path / f"{name}.c").write_text(f"{code}int main(void) {{ return 0; }}\n", encoding="ascii")
        command = ["cc", *STRICT, "-o", tmp_path / name, tmp_path / f"{name}.c", "-lm"]
        errors[name] = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False).stderr
    assert errors["once"] == errors["twice"] == ""
    assert "another controller of ballbot is included already" in errors["both"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("zero", {}, "'zero' cannot be written as C: expected one of lqr, pid, lqi"),
        ("lqrr", {}, "did you mean 'lqr'"),
        ("lqr", {"control_dt": -1.0}, "control_dt = -1 is out of range"),
        ("lqr", {"max_wheel_torque": "much"}, "max_wheel_torque is 'much', expected a number"),
        ("lqr", {"max_wheel_torque": float("nan")}, "max_torque = NaN is out of range"),
        ("lqr", {"position": 0.0}, "position = 0 is out of range"),
        ("lqr", {"delay": 0.03}, "delay = 0.03 of the controller 'lqr' cannot be written as C: it must be 0"),
        ("lqi", {"delay": 0.01}, "delay = 0.01 of the controller 'lqi'"),
        ("cascade_pid", {"lean_observer": 1.0, "max_wheel_torque": 0.2}, "lean_observer = 1.0 of the controller"),
        ("lqr", {"scaled": {"lean_observer": 1.0}}, "lean_observer = 1.0 of the controller"),
        ("hierarchical_sliding_mode", {"adaptation": 9}, "adaptation = 9 of the controller"),
    ],
)
def test_mistakes_are_named(name, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        controller_header(name, **options)
