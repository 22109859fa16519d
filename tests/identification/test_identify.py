"""The fit: what it finds, how sure it is, and what it rejects."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import Params, SensorLog, State, identify, record_log
from ballbot_rs.identification.logs.log import COLUMNS
from validation import identification as study

pytest.importorskip("scipy")

TRUTH = Params.paper().replace(
    body_mass=2.3,
    body_com_height=0.146,
    body_inertia=(0.06, 0.057, 0.014),
    ball_viscous_friction=0.3,
    wheel_viscous_friction=1e-3,
)
MOTORS = {"delay": 0.006}
VISCOUS = ("ball_viscous_friction", "wheel_viscous_friction")
VALUES = ("body_mass", "body_inertia", "body_com_height", *VISCOUS, "delay")


@pytest.fixture(scope="module")
def exact():
    return record_log(TRUTH, 4.0, actuators=MOTORS, noise=None, seed=1)


@pytest.fixture(scope="module")
def noisy():
    return record_log(TRUTH, 4.0, actuators=MOTORS, seed=1)


def truth_of(found):
    values = {**TRUTH.to_dict(), **MOTORS}
    components = {f"body_inertia_{axis}{axis}": TRUTH.body_inertia[i] for i, axis in enumerate("xyz")}
    return np.array([components.get(name, values.get(name)) for name in found.names], dtype=float)


def changed(log, rows=slice(None), **changes):
    fields = {name: getattr(log, name) for name in COLUMNS}
    fields = {name: changes.get(name, value) for name, value in fields.items()}
    return SensorLog(**{name: value if value is None else value[rows] for name, value in fields.items()})


def test_exact_measurements_give_the_exact_robot(exact):
    done = []
    found = identify(exact, "paper", VALUES, num_threads=1, progress=lambda *counts: done.append(counts))
    np.testing.assert_allclose(found.values, truth_of(found), rtol=5e-4)
    assert found.nominal[0] == 2.228
    assert found.rejected == ()
    assert done[-1][0] == done[-1][1] == len(done) - 1
    assert [count for count, _ in done[:-1]] == list(range(1, len(done)))


def test_estimates_are_within_their_uncertainty_and_the_noise_is_found(noisy):
    found = identify(noisy, "paper", VALUES, num_threads=1)
    assert (np.abs(found.values - truth_of(found)) < 3.5 * found.standard_errors).all()
    for name, value in bb.identification.excitation.NOISE.items():
        assert found.noise[name] == pytest.approx(value, rel=0.05)
    # Of seven windows.
    assert (found.standard_errors < 0.2 * truth_of(found)).all()
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    np.testing.assert_allclose(found.intervals.mean(axis=1), found.values)
    low, high = found.interval("delay")
    assert low < 0.006 < high
    assert found.actuators == {"delay": 0.006}
    with pytest.raises(KeyError, match="ball_mass was not fitted: there are body_mass, body_inertia_xx"):
        found.interval("ball_mass")


@pytest.mark.slow("many robots")
def test_intervals_of_random_robots_hold():
    done = study.run(2, seconds=5.0, first=200, num_threads=1)
    assert done.failures == ()
    assert done.covered.shape == (2, 11)
    # Of 22 intervals of 95 %, 17 or more hold with a probability of 99.9 %.
    assert done.covered.sum() >= 17
    assert np.abs(done.scores).max() < 4.5
    assert "2 of 2 fits converged" in study.markdown(done)


@pytest.mark.slow("many robots")
def test_intervals_of_random_payloads_hold():
    done = study.run(2, seconds=8.0, first=200, num_threads=1, payload=True)
    assert done.failures == ()
    assert done.names[-3:] == ("payload_position_x", "payload_position_y", "payload_position_z")
    assert done.covered.shape == (2, 19)
    # Of 38 intervals of 95 %, 31 or more hold with a probability of 99.9 %.
    assert done.covered.sum() >= 31
    assert np.abs(done.scores).max() < 4.5


def test_standard_errors_grow_with_the_noise_given(noisy):
    once, twice = (
        identify(noisy, TRUTH, ("body_com_height", "delay"), noise=noise, actuators=MOTORS, num_threads=1)
        for noise in (
            {"wheel_angle": 1e-3, "gyro": 5e-3, "acceleration": 0.05},
            {"wheel_angle": 2e-3, "gyro": 0.01, "acceleration": 0.1},
        )
    )
    np.testing.assert_allclose(twice.standard_errors, 2.0 * once.standard_errors, rtol=1e-3)
    assert twice.noise == {"wheel_angle": 2e-3, "gyro": 0.01, "acceleration": 0.1}


def test_strength_lag_and_biases(noisy):
    fields = ("strength", "lag", "gyro_bias", "acc_bias")
    motors = {"lag": 0.01, "strength": [0.9, 1.0, 1.1]}
    log = record_log(TRUTH, 4.0, actuators=motors, seed=2)
    gyro_bias, acc_bias = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3])
    biased = changed(log, gyro=log.gyro + gyro_bias, accelerations=log.accelerations + acc_bias)
    found = identify(biased, TRUTH, fields, num_threads=1)
    truth = np.array([0.9, 1.0, 1.1, 0.01, *gyro_bias, *acc_bias])
    assert (np.abs(found.values - truth) < 3.5 * found.standard_errors).all()
    assert (found.standard_errors[:7] < [2e-3, 2e-3, 2e-3, 1e-4, 1e-3, 1e-3, 6e-3]).all()
    assert found.gyro_bias == tuple(found.values[4:7])
    assert set(found.actuators) == {"lag", "strength"}
    without = changed(noisy, accelerations=noisy.accelerations)
    without = SensorLog(without.time, without.torques, without.wheel_angles, without.gyro)
    with pytest.raises(ValueError, match="fields has acc_bias, but the log has no acc_x, acc_y, acc_z"):
        identify(without, TRUTH, fields)


def test_encoders_and_gyroscope_alone_are_enough(exact):
    log = SensorLog(exact.time, exact.torques, exact.wheel_angles, exact.gyro)
    found = identify(log, "paper", VALUES, num_threads=1)
    np.testing.assert_allclose(found.values, truth_of(found), rtol=2e-3)
    assert set(found.noise) == {"wheel_angle", "gyro"}


def test_gaps_and_an_imu_off_the_origin(exact):
    kept = np.ones(len(exact.time), dtype=bool)
    kept[100:130] = False
    found = identify(changed(exact, kept), "paper", VALUES, num_threads=1)
    np.testing.assert_allclose(found.values, truth_of(found), rtol=2e-3)
    place = (0.03, -0.02, 0.2)
    log = record_log(TRUTH, 3.0, noise=None, imu_position=place)
    found = identify(log, TRUTH, ("body_com_height",), imu_position=place, num_threads=1)
    assert found.values[0] == pytest.approx(TRUTH.body_com_height, rel=1e-4)
    with pytest.raises(ValueError, match=r"^acc_[xy] contradicts the other columns: .* or imu_position"):
        identify(log, TRUTH, ("body_com_height",), num_threads=1)


def test_a_friction_that_is_not_there_is_at_its_limit(exact):
    found = identify(exact, TRUTH, ("wheel_coulomb_friction", "delay"), num_threads=1)
    assert found.at_limit == ("wheel_coulomb_friction",)
    assert found.values[0] == pytest.approx(0.0, abs=1e-6)
    assert found.values[1] == pytest.approx(0.006, rel=1e-3)
    assert "at limit" in found.table()
    assert repr(found).startswith(f"<IdentifiedParams from {found.measurements} measurements: {found.names[0]}=")
    assert found._repr_html_() == f"<pre>{found.table()}</pre>"


def test_windows_that_no_robot_explains_are_left_out(noisy):
    torques = noisy.torques.copy()
    # 0.3 s in which the log reports the motors as off, for a hand that pushes or a wheel that slips.
    torques[200:230] = 0.0
    found = identify(
        changed(noisy, torques=torques), TRUTH, ("body_com_height", "delay"), num_threads=1, actuators=MOTORS
    )
    assert found.rejected
    assert min(begin for begin, _ in found.rejected) <= 2.0
    assert max(end for _, end in found.rejected) >= 2.29
    assert all(1.5 <= begin < end <= 2.85 for begin, end in found.rejected)
    assert (np.abs(found.values - [TRUTH.body_com_height, 0.006]) < 3.5 * found.standard_errors).all()
    torques[100:230] = 0.0
    with pytest.raises(
        ValueError, match=r"3 of 7 windows contradict the model, the limit is 2; the first begins at 1.1 s"
    ):
        identify(changed(noisy, torques=torques), TRUTH, ("body_com_height",), num_threads=1, actuators=MOTORS)


def test_robots_with_the_same_motion_are_not_distinguished(noisy):
    """From the ball to the body with first and second moments about the ball's center kept: the motion is the same."""
    more = 0.05
    height = TRUTH.body_mass * TRUTH.body_com_height / (TRUTH.body_mass + more)
    moment = TRUTH.body_mass * TRUTH.body_com_height**2 - (TRUTH.body_mass + more) * height**2
    jxx, jyy, jzz = TRUTH.body_inertia
    other = TRUTH.replace(
        ball_mass=TRUTH.ball_mass - more,
        body_mass=TRUTH.body_mass + more,
        body_com_height=height,
        body_inertia=(jxx + moment, jyy + moment, jzz),
    )
    states = []
    for params in (TRUTH, other):
        robot = bb.Ballbot(params, model="spatial", sim_dt=0.002)
        robot.reset(State.at_rest(params, tilt=(0.05, -0.02)))
        for torques in noisy.torques[:40]:
            robot.step(torques, steps=5)
        states.append(robot.state.to_array())
    assert np.abs(states[0]).max() > 1.0
    np.testing.assert_allclose(states[1], states[0], atol=1e-10)
    group = ("ball_mass", "body_mass", "body_com_height", "body_inertia")
    message = "does not determine ball_mass, body_mass, body_com_height, body_inertia_xx, body_inertia_yy apart from"
    with pytest.raises(ValueError, match=message):
        identify(noisy, TRUTH, group, actuators=MOTORS, num_threads=1)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (("wheel_mass", "body_mass"), "the log does not depend on wheel_mass"),
        (
            ("delay", "floor_dynamic_friction", "wheel_mass"),
            "the log does not depend on wheel_mass, floor_dynamic_friction|floor_dynamic_friction, wheel_mass",
        ),
        (
            ("wheel_zenith", "wheel_zenith_offsets"),
            "does not determine wheel_zenith.* the condition number is .* .limit 3000.",
        ),
        (
            ("strength", "ball_mass", "ball_inertia", "body_mass", "body_inertia", "wheel_inertia", *VISCOUS),
            "does not determine strength_0, strength_1, strength_2, ball_mass, .* apart from each other",
        ),
    ],
)
def test_what_the_log_does_not_determine_is_named(noisy, fields, message):
    with pytest.raises(ValueError, match=message):
        identify(noisy, TRUTH, fields, actuators=MOTORS, num_threads=1)


def test_a_robot_at_rest_determines_little():
    log = record_log(TRUTH, 3.0, excitation=0.0, seed=1)
    with pytest.raises(ValueError, match=r"the log does not (determine|depend on) "):
        identify(log, TRUTH, ("body_mass", "body_inertia", "ball_viscous_friction"), num_threads=1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fields": ()}, "fields is empty"),
        ({"fields": ("body_mas",)}, "unknown field 'body_mas': expected one of .*: did you mean 'body_mass'"),
        ({"fields": ("max_wheel_torque",)}, "unknown field 'max_wheel_torque'"),
        ({"fields": ("floor_tilt",)}, "unknown field 'floor_tilt'"),
        ({"robot": TRUTH.replace(floor_tilt=(0.0, 0.1))}, r"floor_tilt = \[0.0, 0.1\]: a log has no heading"),
        ({"fields": ("delay", "delay")}, "fields names delay twice"),
        ({"robot": "r2d2"}, "r2d2"),
        (
            {"robot": TRUTH.replace(max_wheel_torque=0.1)},
            r"torque_. of row .* is .* N·m, beyond max_wheel_torque = 0.1 N·m",
        ),
        ({"model": "planar"}, "model = 'planar': expected spatial, contact, rigid"),
        ({"model": "flat"}, "model = 'flat': expected spatial, contact, rigid"),
        ({"window": 0.01}, "window = 0.01 s is out of range"),
        ({"window": float("nan")}, "window = nan s is out of range"),
        ({"sim_dt": float("nan")}, "sim_dt = nan s is out of range"),
        (
            {"sim_dt": 1.0},
            "sim_dt = 1.0 s is out of range: it must be above 0 and at most the log's median step, 0.01 s",
        ),
        ({"imu_position": (0, 0)}, r"imu_position is \(0, 0\), expected three finite numbers"),
        ({"rejection": 0.5}, "rejection = 0.5, it must be above 1"),
        ({"noise": {"gyro": 0.01}}, "noise lacks wheel_angle, acceleration"),
        ({"noise": {"gyros": 0.01}}, "unknown sensor 'gyros' in noise"),
        ({"noise": {"gyro": 0.0}}, "noise of gyro is 0.0, it must be finite and above 0"),
        ({"actuators": {"delay": 0.5}}, "actuators: delay = 0.5 is out of range: it must be from 0 to 0.1"),
        ({"actuators": {"dealy": 0.5}}, "unknown actuator option 'dealy': .*did you mean 'delay'"),
        ({"actuators": "kugle"}, "stall_torque = 15.4375 is not supported by identification"),
    ],
)
def test_bad_arguments_are_rejected_with_value_and_limit(exact, arguments, message):
    with pytest.raises(ValueError, match=message):
        identify(exact, **{"robot": TRUTH, "fields": ("delay",), **arguments})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seconds": 0.0}, "seconds = 0.0 is out of range"),
        ({"excitation": -1.0}, "excitation = -1.0 is out of range"),
        ({"noise": {"gyro": -1.0}}, "noise of gyro is -1.0, it must be finite and at least 0"),
        ({"noise": {"gyros": 1.0}}, "unknown sensor 'gyros'"),
        ({"imu_position": 1.0}, "imu_position is 1.0"),
        ({"seed": -1}, "seed = -1 is out of range"),
    ],
)
def test_bad_arguments_of_a_recording_are_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        record_log(**{"seconds": 1.0, **arguments})


def test_a_recording_is_repeated_by_its_seed_and_a_fall_is_an_error():
    first, again, other = (record_log(seconds=0.5, seed=seed) for seed in (3, 3, 4))
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert (first.torques != other.torques).any()
    with pytest.raises(bb.DivergedError, match=r"the robot falls at .* s: lower the excitation of 10"):
        record_log(seconds=10.0, excitation=10.0)


def test_an_interrupt_ends_a_fit(exact):
    def interrupt(done, _):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(exact, TRUTH, ("delay",), progress=interrupt)


FIELDS = {
    "friction": ("wheel_viscous_friction", "wheel_coulomb_friction"),
    "inertia": ("body_mass", "body_inertia", "body_com_height"),
    "motors": ("delay", "strength"),
    "imu": ("gyro_bias", "acc_bias"),
}


def negated(name, axis):
    return lambda log: {name: getattr(log, name) * np.where(np.arange(3) == axis, -1.0, 1.0)}


WRONG = {
    **{
        f"{name}_{axis}": negated(name, axis) for name in ("gyro", "accelerations", "wheel_angles") for axis in range(3)
    },
    "torques": lambda log: {"torques": -log.torques},
    "gyro in turns": lambda log: {"gyro": log.gyro / (2.0 * np.pi)},
    "gyro in deg": lambda log: {"gyro": np.degrees(log.gyro)},
    "angles of the motors": lambda log: {"wheel_angles": 10.0 * log.wheel_angles},
    "angles in turns": lambda log: {"wheel_angles": log.wheel_angles / (2.0 * np.pi)},
    "axes of the gyro": lambda log: {"gyro": log.gyro[:, [1, 0, 2]]},
    "axes of the accelerometer": lambda log: {"accelerations": log.accelerations[:, [1, 0, 2]]},
    "order of the encoders": lambda log: {"wheel_angles": log.wheel_angles[:, [1, 2, 0]]},
    "order of the torques": lambda log: {"torques": log.torques[:, [1, 0, 2]]},
}


@pytest.mark.parametrize("fields", FIELDS.values(), ids=FIELDS)
@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_a_wrong_column_is_rejected_whatever_is_fitted(noisy, wrong, fields):
    message = "contradicts the other columns|windows contradict the model|the limit is|looks? (wrong|like)"
    with pytest.raises(ValueError, match=message):
        identify(changed(noisy, **wrong(noisy)), "paper", fields, num_threads=1)


@pytest.mark.parametrize(
    "nominal",
    [
        {"body_mass": 1.4 * TRUTH.body_mass},
        {"body_com_height": 1.3 * TRUTH.body_com_height},
        {"body_inertia": tuple(2.0 * np.array(TRUTH.body_inertia))},
        {"wheel_zenith": 1.1 * TRUTH.wheel_zenith},
    ],
    ids=lambda one: next(iter(one)),
)
def test_a_fit_may_start_from_a_robot_that_is_far_off(exact, nominal):
    found = identify(exact, TRUTH.replace(**nominal), tuple(nominal), actuators=MOTORS, num_threads=1)
    desired = np.ravel([getattr(TRUTH, name) for name in nominal])
    np.testing.assert_allclose(found.values, desired, rtol=2e-3)


def test_the_table_has_residual_noise_and_rejected_windows(noisy):
    torques = noisy.torques.copy()
    torques[200:230] = 0.0
    found = identify(changed(noisy, torques=torques), TRUTH, ("delay",), num_threads=1, actuators=MOTORS)
    text = found.table()
    assert f"gyro {found.noise['gyro']:.2g} rad/s" in text
    (begin, end), *_ = found.rejected
    assert f"rejected windows, which the model does not explain: {len(found.rejected)} of {found.windows}" in text
    assert f"  {begin:.2f} to {end:.2f} s" in text
