"""A payload that sways: found from a log, distinguished from a payload that is fixed, and replayed."""

import json

import numpy as np
import pytest

from ballbot_rs import Params, identify, record_log, replay
from ballbot_rs.cli import main

pytest.importorskip("scipy")

MASS, STIFFNESS, DAMPING, PLACE = 0.45, 75.0, 0.9, (0.0, 0.0, 0.21)
LOADED = Params.paper().with_payload(MASS, position=PLACE, stiffness=STIFFNESS, damping=DAMPING)
#: 30 % off; the whole body is known.
OFF = LOADED.replace(
    payload_mass=1.3 * MASS, payload_stiffness=(1.3 * STIFFNESS,) * 3, payload_damping=(0.7 * DAMPING,) * 3
)
PAYLOAD = ("payload_mass", "payload_stiffness", "payload_damping")
BODY = ("body_mass", "body_inertia", "body_com_height")
NAMES = ("payload_mass", "payload_stiffness_x", "payload_stiffness_y", "payload_damping_x", "payload_damping_y")
TRUTH = np.array([MASS, STIFFNESS, STIFFNESS, DAMPING, DAMPING])


@pytest.fixture(scope="module")
def exact():
    return record_log(LOADED, 5.0, noise=None, seed=1)


@pytest.fixture(scope="module")
def noisy():
    return record_log(LOADED, 10.0, seed=1)


def test_exact_measurements_give_the_exact_payload(exact):
    found = identify(exact, OFF, PAYLOAD, num_threads=1)
    # Along z the ball carries it.
    assert found.names == NAMES
    np.testing.assert_allclose(found.values, TRUTH, rtol=0.02)
    assert found.units == ("kg", "N/m", "N/m", "N/(m/s)", "N/(m/s)")
    # The mass is a part of the body's.
    assert found.params.body_mass == LOADED.body_mass
    assert found.params.payload_stiffness[2] == OFF.payload_stiffness[2]


def test_the_place_is_found(exact):
    start = OFF.replace(payload_position=(0.01, -0.01, 0.17))
    found = identify(exact, start, (*PAYLOAD, "payload_position"), num_threads=1)
    np.testing.assert_allclose(found.values[:5], TRUTH, rtol=0.03)
    assert found.names[5:] == ("payload_position_x", "payload_position_y", "payload_position_z")
    np.testing.assert_allclose(found.values[5:], PLACE, atol=1e-3)


@pytest.mark.slow("ten numbers")
def test_a_payload_of_unknown_mass_on_a_known_robot(noisy):
    """`with_payload` of another mass changes mass, inertia and CoM of the whole body: they are fitted, too."""
    start = Params.paper().with_payload(1.3 * MASS, position=PLACE, stiffness=1.3 * STIFFNESS, damping=DAMPING)
    found = identify(noisy, start, (*PAYLOAD, *BODY), num_threads=1)
    truth = np.array([*TRUTH, LOADED.body_mass, *LOADED.body_inertia, LOADED.body_com_height])
    assert (np.abs(found.values - truth) < 3.5 * found.standard_errors).all()
    assert found.standard_errors[0] < 0.15 * MASS
    assert found.standard_errors[5] < 0.01 * LOADED.body_mass
    back = Params.from_toml(found.to_toml())
    assert back.payload_mass == found.values[0]


@pytest.mark.parametrize("fields", [("payload_mass",), pytest.param(PAYLOAD, marks=pytest.mark.slow("long search"))])
def test_a_robot_without_payload_shows_none(fields):
    log = record_log("paper", 5.0, seed=1)
    paper = Params.paper()
    start = paper.replace(
        payload_mass=0.3, payload_position=PLACE, payload_stiffness=(60.0,) * 3, payload_damping=(0.3,) * 3
    )
    with pytest.raises(ValueError, match=r"the log (shows no payload that sways|does not determine payload_)"):
        identify(log, start, fields, num_threads=1)
    with pytest.raises(ValueError, match=r"fields has payload_mass, but the robot has no payload: start from"):
        identify(log, paper, fields)


@pytest.mark.parametrize(
    "fields",
    [("ball_mass", *BODY), ("strength", "ball_mass", "ball_inertia", "body_mass", "body_inertia", "wheel_inertia")],
)
def test_what_no_log_determines_is_named_with_a_payload_too(noisy, fields):
    """One factor on torques, masses, inertias, springs and dampers gives the same motion."""
    message = f"does not determine {fields[0]}.* apart from each other: the condition number"
    with pytest.raises(ValueError, match=message):
        identify(noisy, LOADED, (*fields, *PAYLOAD), num_threads=1)


def test_the_motion_of_an_arm_is_not_in_a_log(exact):
    with pytest.raises(ValueError, match=r"payload_amplitude = \[0.01, 0.0, 0.0\] must be 0: a log lacks"):
        identify(exact, LOADED.replace(payload_amplitude=(0.01, 0.0, 0.0)), ("payload_mass",))
    with pytest.raises(ValueError, match="unknown field 'payload_period'"):
        identify(exact, LOADED, ("payload_period",))
    with pytest.raises(ValueError, match=r"second_payload_mass = 0.1 must be 0: only one payload can be fitted"):
        identify(exact, LOADED.with_payload(0.1, stiffness=10.0, payload=1), ("payload_mass",))


def test_other_numbers_are_fitted_on_a_robot_with_a_payload(exact):
    found = identify(exact, LOADED.replace(body_com_height=0.16), ("body_com_height",), num_threads=1)
    assert found.values[0] == pytest.approx(LOADED.body_com_height, rel=1e-3)
    fixed = identify(exact, LOADED.with_payloads_fixed(), ("body_com_height",), num_threads=1)
    assert fixed.noise["gyro"] > 10.0 * found.noise["gyro"]
    assert abs(fixed.values[0] - LOADED.body_com_height) > 10.0 * abs(found.values[0] - LOADED.body_com_height)


def test_a_replay_sways(noisy):
    sways, fixed = (replay(noisy, robot, num_threads=1) for robot in (LOADED, LOADED.with_payloads_fixed()))
    for one, other in zip(sways.residuals, fixed.residuals, strict=True):
        # The noise is estimated from third differences.
        assert one.rms < 1.1 * one.noise, one
        assert one.rms < other.rms, one
    assert fixed.residuals[3].rms > 1.5 * sways.residuals[3].rms


def test_the_command_fits_a_payload(noisy, tmp_path, capsys):
    log, robot, out = (tmp_path / name for name in ("log.csv", "robot.toml", "found.toml"))
    noisy.write(log)
    robot.write_text(OFF.to_toml())
    command = ["identify", str(log), "--robot", str(robot), "--fields", ",".join(PAYLOAD), "-o", str(out), "--json"]
    assert main(command) in (None, 0)
    fitted = json.loads(capsys.readouterr().out)["fitted"]
    assert tuple(fitted) == NAMES
    low, high = fitted["payload_mass"]["interval"]
    assert low < MASS < high
    assert Params.from_toml(out).payload_mass == pytest.approx(fitted["payload_mass"]["value"])
