"""Impulses of a rollout, at the center of mass and at other points of the body."""

import numpy as np
import pytest

import ballbot_rs as bb

IMPULSES = np.array([[[0.1, 0.0, 0.0], [0.0, -0.2, 0.05]], [[0.0, 0.0, 0.0], [0.1, 0.1, 0.0]]])
POINTS = np.array([[0.0, 0.05, 0.3], [0.1, 0.0, 0.1]])


def batch():
    found = bb.Batch(2, num_threads=1)
    found.reset(starts=[bb.State.at_rest(bb.Params.paper())] * 2)
    return found


@pytest.mark.parametrize("points", [None, POINTS])
def test_impulses_are_pushes_before_the_steps(points):
    together = batch().rollout(bb.Lqr(), 20, impulses=IMPULSES, points=points)["states"]
    alone = batch()
    for step in range(2):
        for i in range(2):
            alone.push(i, IMPULSES[step, i], None if points is None else points[i])
        states = alone.rollout(bb.Lqr(), 1 if step == 0 else 19)["states"]
        first = step
        np.testing.assert_array_equal(states[1:], together[first + 1 : first + len(states)])


def test_a_push_off_the_mast_turns_the_robot():
    push = np.array([[[0.1, 0.0, 0.0], [0.1, 0.0, 0.0]]])
    com = np.array(bb.Params.paper().body_com)
    points = com + np.array([[0.0, 0.0, 0.0], [0.0, 0.05, 0.0]])
    found = batch().rollout(bb.Pid(control_dt=0.01), 1, impulses=push, points=points)["states"][-1]
    center, off_center = (bb.State.from_array(row) for row in found)
    assert abs(center.yaw) < 1e-9
    # To the left of a push along x: clockwise.
    assert off_center.yaw < -1e-4


def test_points_are_checked():
    for points, message in ((POINTS[:1], "points"), (POINTS * np.nan, "points"), (POINTS[:, :2], "points")):
        with pytest.raises(ValueError, match=message):
            batch().rollout(bb.Lqr(), 2, impulses=IMPULSES, points=points)
