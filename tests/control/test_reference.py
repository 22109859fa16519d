"""The target on the way to a goal: its limits, and the lead that a controller can follow."""

import math

import numpy as np
import pytest

from ballbot_rs import Lqr, Params, State
from ballbot_rs.control.reference import LEAD_STEP, MAX_LEAD, Reference, largest_lead


def test_the_target_reaches_the_goal_within_its_limits_and_does_not_pass_it():
    reference, goal, dt = Reference(lead=0.2), np.array([3.0, -4.0]), 0.01
    before, velocity = np.zeros(2), np.zeros(2)
    for _ in range(5000):
        # A ball that is on the target at once.
        target = reference.advance(goal, before, dt).copy()
        speed = (target - before) / dt
        assert np.linalg.norm(speed) <= reference.max_speed * (1.0 + 1e-9)
        assert np.linalg.norm(speed - velocity) <= reference.max_acceleration * dt * (1.0 + 1e-6)
        assert np.linalg.norm(target) <= 5.0 + 1e-9
        before, velocity = target, speed
        if np.array_equal(target, goal):
            break
    np.testing.assert_allclose(target, goal, atol=1e-9)


def test_the_target_waits_for_a_ball_that_does_not_come():
    reference, ball = Reference(lead=0.2), np.array([1.0, 1.0])
    reference.start(ball, (0.0, 0.0))
    for _ in range(1000):
        target = reference.advance((5.0, 1.0), ball, 0.01)
        assert np.linalg.norm(target - ball) <= 0.2 * (1.0 + 1e-12)
    np.testing.assert_allclose(target, [1.2, 1.0])
    # A ball that was carried away moves the target with it.
    target = reference.advance((5.0, 1.0), ball - 3.0, 0.01)
    assert np.linalg.norm(target - (ball - 3.0)) == pytest.approx(0.2)


def test_a_ball_that_rolls_is_not_stopped_at_once():
    reference = Reference(lead=0.2)
    reference.start((1.0, 0.0), (0.1, 0.0))
    np.testing.assert_allclose(reference.position, [1.05, 0.0])
    reference.start((1.0, 0.0), (50.0, 0.0))
    np.testing.assert_allclose(reference.position, [1.2, 0.0])


@pytest.mark.parametrize("lead", [0.0, -1.0, math.nan, math.inf])
def test_a_lead_out_of_range_is_rejected(lead):
    with pytest.raises(ValueError, match=f"lead = {lead}"):
        Reference(lead)
    with pytest.raises(ValueError, match="limit = 0"):
        largest_lead(lambda target: target, 0.0)


def test_the_lead_of_a_linear_law_is_where_its_torque_reaches_the_limit():
    """τ = −K x: the worst wheel and direction have the largest norm of K's two columns of the position."""
    params = Params.paper()
    law = Lqr(params, max_torque=5.0)
    per_metre = np.linalg.norm(law.gain[:, :2], axis=1).max()
    rest, limit = State.at_rest(params), 0.2
    lead = largest_lead(lambda target: law(rest, position=target), limit)
    assert 0.0 <= limit / per_metre - lead < LEAD_STEP * 1.05
    assert largest_lead(lambda target: 1e-6 * target, limit) == MAX_LEAD
    assert largest_lead(lambda target: 1e6 * target, limit) == LEAD_STEP
