"""The estimator's covariance at rest compared with the steady Kalman filter of python-control."""

import control
import numpy as np
import pytest
import scipy.linalg

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS, estimator_constants
from ballbot_rs.deployment import estimator_header
from tests.support.c_code import CEstimator

SENSORS = {
    "gyro_noise": 2e-4,
    # So large that the filter is steady within seconds.
    "gyro_bias_walk": 0.01,
    "accelerometer_noise": 3e-3,
    "encoder_ticks": 4096,
    "imu_position": (0.0, 0.0, 0.2),
}
DT = 0.01
#: Tilt, gyroscope bias and velocity, about and along x and y: observable by wheels and gyroscope at rest. The
#: heading is not observed, and of the spin and the bias about the vertical only the difference.
SEEN = [0, 1, 3, 4, 6, 7]


def steady(params: bb.Params):
    """The covariance after a reading, of the filter of docs/estimator.md for an upright robot at rest."""
    c = estimator_constants(params, SENSORS, DT)
    variance = c["gyro_variance"]
    # Of the errors δθ, δb, ξ: δθ' = −δb − n, ξ' = g (δθ_y, −δθ_x) + n_a, and the spin.
    rates = np.zeros((9, 9))
    rates[0:3, 3:6] = -np.eye(3)
    rates[6, 1], rates[7, 0] = params.gravity, -params.gravity
    step = scipy.linalg.expm(rates * DT)
    # A reading's error acts as the bias does, over its step.
    driven = step[:, 3:6] - np.eye(9)[:, 3:6]
    q = variance * driven @ driven.T
    q += np.diag([0.0] * 3 + [*c["bias_step"]] + [c["velocity_step"]] * 2 + [c["spin_step"]])

    wheels = np.asarray(c["wheels_of_ball"])
    m = np.cross(wheels, [0.0, 0.0, 1.0]) / params.ball_radius
    d = -wheels - np.cross(SENSORS["imu_position"], m)
    h = np.hstack([np.zeros((3, 3)), -d, m[:, :2], wheels[:, 2:]])
    r = variance * d @ d.T + c["encoder_variance"] * np.eye(3)
    # The same error is in the attitude and in the expected wheel rates.
    shared = np.zeros((9, 3))
    shared[:3] = DT * variance * d.T

    # As rates of the ball about x, y and z the wheels' rates separate.
    turn = np.linalg.inv(wheels)
    h, r, shared = turn @ h, turn @ r @ turn.T, shared @ turn.T
    unseen = [2, 5, 8]
    np.testing.assert_allclose(h[:2, unseen], 0.0, atol=1e-12 * np.abs(h).max())
    np.testing.assert_allclose(r[:2, 2], 0.0, atol=1e-12 * np.abs(r).max())
    block = np.ix_(SEEN, SEEN)
    a, q, h, r, shared = step[block], q[block], h[:2, SEEN], r[:2, :2], shared[SEEN, :2]
    # A reading after the step, of the state before it: y = H A x + (H w + v).
    reading = h @ q @ h.T + h @ shared + (h @ shared).T + r
    covariance, _, _ = control.dare(a.T, (h @ a).T, q, reading, q @ h.T + shared)
    return covariance


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_covariance_converges_to_python_control(robot, tmp_path):
    params = bb.Params.preset(robot)
    in_c = CEstimator(tmp_path, estimator_header(params, SENSORS, DT))
    in_c.begin(bb.State.at_rest(params))
    at_rest = {"gyro": np.zeros(3), "specific_force": np.array([0.0, 0.0, params.gravity]), "wheel_rates": np.zeros(3)}
    for _ in range(4000):
        in_c.update(at_rest)
    found, expected = in_c.covariance()[np.ix_(SEEN, SEEN)], steady(params)
    deviations = np.sqrt(np.diag(expected))
    differences = (found - expected) / np.outer(deviations, deviations)
    assert np.abs(differences).max() < 1e-11
