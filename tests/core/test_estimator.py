"""The estimator of one robot has the states of a batch, bit for bit, whatever its sensors and motion are."""

import copy
import pickle

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS

#: Errors of every kind, and two steps of latency.
POOR = {
    "gyro_noise": 0.001,
    "gyro_bias": 0.02,
    "gyro_bias_walk": 0.01,
    "gyro_range": 5.0,
    "accelerometer_noise": 0.01,
    "accelerometer_bias": 0.1,
    "imu_position": [0.01, 0.0, 0.2],
    "imu_misalignment": 0.02,
    "encoder_ticks": 4096.0,
    "latency": 0.02,
}
#: At rest, the robot upright.
REST = {"gyro": [0.0] * 3, "specific_force": [0.0, 0.0, 9.81], "wheel_angles": [0.0] * 3}


def bits(state):
    return state.to_array().tobytes()


@pytest.mark.parametrize("sensors", ["exact", "kugle", POOR], ids=["exact", "kugle", "poor"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_estimates_are_the_estimates_of_a_batch_bit_for_bit(robot, sensors):
    """Under random torques that make wheels slip; robots in all lanes of the core, and alone."""
    options = {"sensors": sensors, "observation": "sensors", "max_episode_steps": 300}
    batch = bb.Batch(9, robot=robot, model="contact", num_threads=1, seed=3, **options)
    batch.reset()
    law, rng = bb.Lqr(robot), np.random.default_rng(5)
    watched = {i: bb.Estimator(robot, sensors) for i in (0, 5, 8)}
    for i, estimator in watched.items():
        estimator.reset(batch.state(i))
    begins, slips, episodes = np.ones(9, dtype=bool), 0, 0
    for step in range(1000):
        for i, estimator in watched.items():
            readings = batch.readings(i)
            if step % 2 and not begins[i]:
                # They follow from the angles.
                del readings["wheel_rates"]
            assert bits(estimator.update(readings)) == bits(batch.estimate(i)), step
            assert bits(estimator.state) == bits(batch.estimate(i))
            slips += int(estimator.slipping.any())
        kicks = rng.uniform(-1.0, 1.0, (9, 3)) * (rng.random((9, 1)) < 0.2)
        _, _, terminated, truncated, *_ = batch.step(np.clip(batch.control(law) + kicks, -1.0, 1.0))
        begins = terminated | truncated
        episodes += int(begins.sum())
        for i in set(watched) & set(np.flatnonzero(begins).tolist()):
            watched[i].reset(batch.state(i))
    assert episodes >= 27
    assert slips > 5


def test_an_episode_begins_in_the_attitude_of_the_accelerometer():
    tilted = bb.State.at_rest(bb.Params.paper(), tilt=(0.05, -0.03))
    robot = bb.Batch(1, sensors="exact", model="contact")
    robot.reset(starts=[tilted])
    found = bb.Estimator().update({**robot.readings(0), "wheel_rates": [0.0] * 3})
    np.testing.assert_allclose(found.body_quaternion, tilted.body_quaternion, atol=1e-14)
    assert found.yaw == pytest.approx(0.0, abs=1e-14)
    assert np.array_equal(found.ball_position[:2], [0.0, 0.0])


def test_covariances_grow_where_nothing_measures():
    estimator = bb.Estimator(sensors="kugle")
    estimator.update(REST)
    before = estimator.attitude_covariance
    for _ in range(100):
        estimator.update(REST)
    after = estimator.attitude_covariance
    np.testing.assert_allclose(after, after.T, atol=1e-15)
    assert np.linalg.eigvalsh(after).min() > 0.0
    # The yaw is not measured, the tilt is: by the velocity.
    assert after[2, 2] > before[2, 2]
    assert after[0, 0] < before[0, 0]
    assert estimator.velocity_covariance.shape == (2, 2)
    assert not estimator.slipping.any()


def test_a_constant_rate_of_the_gyroscope_at_rest_is_its_bias():
    estimator = bb.Estimator(sensors={"gyro_noise": 1e-3, "gyro_bias": 0.02, "encoder_ticks": 70_000})
    for _ in range(1000):
        state = estimator.update({**REST, "gyro": [0.01, -0.005, 0.0]})
    np.testing.assert_allclose(estimator.gyro_bias[:2], [0.01, -0.005], atol=1e-3)
    assert state.tilt < 2e-3
    assert estimator.balanced_state.tilt < 2e-3


@pytest.mark.parametrize("sensors", ["exact", "kugle"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_bias_that_the_sensors_leave_out_topples_nobody(robot, sensors):
    """The options of these sensors have no bias, events give each gyroscope one that starts at 0.3 deg/s and walks."""
    bias = [
        {"term": f"sensors.gyro_{name}", "op": "abs", "range": [x, x]}
        for name, x in (("bias", 5e-3), ("bias_walk", 1e-3))
    ]
    options = {"robot": robot, "sensors": sensors, "observation": "sensors", "max_episode_steps": 2000}
    for events in ([], bias):
        result = bb.evaluate("lqr", episodes=20, seed=1, events=events, **options)
        assert result.success_rate == 1.0, events


def test_an_equilibrium_elsewhere_is_the_lean_bias():
    """Upright at rest although the center of mass is off the mast: it leans back by the difference."""
    robot = bb.Params.paper().replace(body_com_offset=(0.004, 0.0))
    estimator = bb.Estimator(robot, "exact")
    for _ in range(2000):
        estimator.update(REST)
    lean = np.arctan2(0.004, robot.body_com_height)
    np.testing.assert_allclose(estimator.lean_bias, [lean, 0.0], atol=1e-5)
    assert estimator.balanced_state.tilt == pytest.approx(lean, abs=1e-5)


def test_copies_have_their_own_memory():
    estimator = bb.Estimator(sensors="kugle")
    estimator.update(REST)
    pushed = {**REST, "gyro": [0.3, 0.2, 0.1]}
    for other in (copy.copy(estimator), copy.deepcopy([estimator])[0]):
        expected = bits(copy.copy(estimator).update(pushed))
        assert bits(other.update(pushed)) == expected
        assert bits(estimator.state) != expected
    with pytest.raises(TypeError, match="Estimator objects cannot be pickled: make another"):
        pickle.dumps(estimator)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": [1.0]}, r"gyro has shape \(1,\), expected \(3,\)"),
        ({"gyro": [0.0, float("nan"), 0.0]}, r"gyro\[1\] = NaN"),
        ({"wheel_angles": [0.0, 1e10, 0.0]}, r"wheel_angles\[1\] = 10000000000 is out of range: it must be within"),
        ({"wheel_rates": [float("inf")] * 3}, r"wheel_rates\[0\] = inf"),
        ({"specific_force": [0.0] * 3}, r"specific_force = \[0, 0, 0\] m/s²: no attitude at rest follows from it"),
        ({"specific_force": [0.0, 0.0, -9.8]}, "no attitude at rest follows from it"),
        ({"giro": [0.0] * 3}, r"unknown readings 'giro': expected one of gyro, .*did you mean 'gyro'\?"),
    ],
)
def test_readings_that_are_none_change_nothing(changes, message):
    estimator, other = bb.Estimator(), bb.Estimator()
    with pytest.raises(bb.InvalidInputError, match=message):
        estimator.update({**REST, **changes})
    assert bits(estimator.update(REST)) == bits(other.update(REST))


def test_readings_that_are_missing_are_named():
    with pytest.raises(bb.InvalidInputError, match="readings have no specific_force: expected gyro, specific_force"):
        bb.Estimator().update({"gyro": [0.0] * 3, "wheel_angles": [0.0] * 3})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"control_dt": 0.0}, "control_dt = 0 is out of range: it must be > 0 and <= 1 s"),
        ({"control_dt": 2.0}, "control_dt = 2 is out of range"),
        ({"sensors": {"latency": 0.005}}, r"sensors.latency / control_dt = 0.5"),
        ({"sensors": {"encoder_rate": 50.0}}, "sensors.encoder_rate = 50 .*at least the control rate"),
        ({"sensors": "kugel"}, "unknown sensors 'kugel'"),
        ({"robot": "kugel"}, "unknown .*'kugel'"),
    ],
)
def test_options_out_of_range_are_named(options, message):
    with pytest.raises(bb.InvalidInputError, match=message):
        bb.Estimator(**options)
