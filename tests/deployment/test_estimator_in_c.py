"""The estimator as C99: equal to ours step by step, with noisy sensors and under pushes that make wheels slip."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.deployment import estimator_header
from tests.deployment.test_controllers_in_c import ROBOTS, UNEVEN
from tests.support.c_code import CEstimator, state_row

TOLERANCE = 1e-6
STEPS = 300
SENSORS = {
    "exact": {"gyro_noise": 0.0},
    "hobby": {
        "gyro_noise": 2e-4,
        "gyro_bias": 0.01,
        "accelerometer_noise": 3e-3,
        "accelerometer_bias": 0.05,
        "encoder_ticks": 4096,
        "imu_position": (0.02, -0.01, 0.3),
        "imu_misalignment": 0.005,
    },
}


def episode(params, sensors, push, steps=STEPS):
    """A balancing robot: the state at the start, and readings with estimates of each step."""
    options = {"robot": params, "sensors": sensors, "observation": "sensors", "fall_tilt": 3.0}
    options["max_wheel_torque"] = params.max_wheel_torque
    batch = bb.Batch(1, "balance", seed=11, model="contact", num_threads=1, **options)
    batch.reset()
    # A gentle law: the push and a large torque together lift a wheel of rezero.
    start, law = batch.state(0), bb.Lqr(params, torque=0.2)
    grip = law.constants()["slipping_torque"]
    seen = [(batch.readings(0), batch.estimate(0))]
    for step in range(steps):
        if step % 100 == 50:
            batch.push(0, push)
        torques = law(batch.estimate(0))
        if step % 100 == 80:
            # More than friction passes on.
            torques = min(2.5 * grip, params.max_wheel_torque) * np.array([1.0, -1.0, 1.0])
        _, _, terminated, _ = batch.step([torques / params.max_wheel_torque])
        assert not terminated[0]
        seen.append((batch.readings(0), batch.estimate(0)))
    return start, seen


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", SENSORS)
def test_an_estimator_in_c_has_our_states(kind, robot, tmp_path):
    params, sensors = ROBOTS[robot], SENSORS[kind]
    impulse = 0.25 * (params.body_mass + params.ball_mass)
    start, seen = episode(params, sensors, (impulse, 0.3 * impulse, 0.0))
    header = estimator_header(params, sensors)
    slipping, largest = 0.0, {}
    # With exact sensors, single precision is rejected.
    for real in ("double", "float") if kind == "hobby" else ("double",):
        in_c = CEstimator(tmp_path, header, real)
        in_c.begin(start)
        differences = []
        for readings, expected in seen:
            row, slips, _, _ = in_c.update(readings)
            differences.append(np.abs(row - state_row(expected)))
            slipping += slips.sum()
        differences = np.array(differences)
        largest[real] = differences.max()
        parts = [("attitude", 0, 4), ("position", 7, 9), ("velocity", 9, 11), ("ball rate", 11, 14)]
        print(kind, robot, real, *(f"{part} {differences[:, first:last].max():.1e}" for part, first, last in parts))
        assert differences[:, :11].max() < (TOLERANCE if real == "double" else 1e-4)
    assert largest["double"] < TOLERANCE
    assert slipping > 0
    # The robot moved.
    assert max(abs(expected.ball_velocity).max() for _, expected in seen) > 0.1


def test_sensors_that_need_double_precision_reject_single_precision(tmp_path):
    with pytest.raises(AssertionError, match="ballbot_estimator_of_these_sensors_needs_double"):
        CEstimator(tmp_path, estimator_header("paper", {}), "float")


def test_the_lean_bias_matches_an_offset_mass(tmp_path):
    """The body's center of mass is 4 mm off, which the estimator does not model."""
    nominal = bb.Params.paper()
    batch = bb.Batch(
        1, "balance", model="contact", sensors={}, observation="sensors", num_threads=1, max_episode_steps=5000
    )
    batch.set_params(0, nominal.replace(body_com_offset=(0.004, 0.0)))
    batch.reset()
    in_c, law = CEstimator(tmp_path, estimator_header(nominal, {})), bb.Lqr(nominal)
    in_c.begin(batch.state(0))
    in_c.update(batch.readings(0))
    for _ in range(1500):
        batch.step([law(batch.estimate(0)) / batch.max_wheel_torque])
        _, _, lean_bias, balanced = in_c.update(batch.readings(0))
    # It leans back until the mass is above the ball.
    np.testing.assert_allclose(lean_bias, [-np.arctan2(0.004, nominal.body_com_height), 0.0], atol=5e-4)
    # The balanced attitude is upright where the robot is in equilibrium.
    _, x, y, _ = balanced
    assert np.hypot(x, y) * 2.0 < 2e-3 < 2.0 * np.hypot(*batch.estimate(0).body_quaternion[1:3])


def test_robots_have_separate_numbers():
    assert estimator_header(UNEVEN, "kugle") != estimator_header("paper", "kugle")
    assert estimator_header("paper", "kugle", 0.005) != estimator_header("paper", "kugle")


MPU_9250 = {"gyro_noise": 9.2e-4, "gyro_bias": 0.02, "accelerometer_noise": 1.4e-3, "encoder_ticks": 4096}


@pytest.mark.slow("many robots")
@pytest.mark.parametrize(("events", "limits"), [(None, (0.7, 1.4)), ("mild", (0.7, 1.6)), ("hard", (1.0, 3.0))])
def test_the_covariance_of_the_velocity_holds_for_robots_that_are_off(events, limits, tmp_path):
    """The squared error by its covariance, 2 if they agree; under hard it was 5.9, as wheels were taken for exact."""
    robots, steps = 30, 400
    options = {"sensors": MPU_9250, "observation": "sensors", "events": events}
    options["max_wheel_torque"] = bb.Params.paper().max_wheel_torque
    batch = bb.Batch(robots, "velocity", seed=5, model="contact", num_threads=1, **options)
    batch.reset()
    starts, law = [batch.state(i) for i in range(robots)], bb.Lqr()
    seen = [[batch.readings(i) for i in range(robots)]]
    states, upright = [batch.states()], np.ones(robots, dtype=bool)
    standing = [upright.copy()]
    for _ in range(steps):
        upright &= ~batch.step(batch.control(law))[2]
        standing.append(upright.copy())
        seen.append([batch.readings(i) for i in range(robots)])
        states.append(batch.states())
    header, squares = estimator_header("paper", MPU_9250), []
    for i in range(robots):
        in_c = CEstimator(tmp_path, header)
        in_c.begin(starts[i])
        for step in range(steps + 1):
            row, _, _, _ = in_c.update(seen[step][i])
            if step < 20 or not standing[step][i]:
                continue
            # Without the error of the heading, which turns the velocity with it.
            (w, x, y, z), (a, b, c, d) = states[step][i, 16:20], row[:4]
            turn = 2.0 * np.arctan2(z * a - w * d - x * c + y * b, w * a + x * b + y * c + z * d)
            cos, sin = np.cos(turn), np.sin(turn)
            error = states[step][i, 20:22] - np.array([[cos, -sin], [sin, cos]]) @ row[9:11]
            squares.append(error @ np.linalg.solve(in_c.covariance()[6:8, 6:8], error))
    mean = np.mean(squares)
    print(f"velocity, events {events}: {mean:.2f}")
    assert limits[0] < mean < limits[1]
