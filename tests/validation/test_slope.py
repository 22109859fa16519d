"""A robot on a slope moves in MuJoCo as it does here."""

import numpy as np
import pytest

import ballbot_rs as bb

pytest.importorskip("mujoco")

from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
from ballbot_rs.engines.robot_geometry import robot_geometry


def test_mujoco_agrees_on_a_tilted_floor(paper):
    tilted = paper.replace(floor_tilt=(0.03, -0.05))
    start = bb.State.at_equilibrium(tilted, tilted.slope_lean(), yaw=0.3)
    # More than holds it, so that it falls.
    torques = np.add(tilted.holding_torques(0.3), [0.01, 0.0, -0.01])
    theirs = MujocoRobot(robot_geometry(tilted), accurate())
    still = np.zeros(3)
    theirs.reset_raw(start.body_quaternion, still, still, start.ball_position, still, still)
    ours = bb.Ballbot(tilted, "spatial", theirs.sim_dt)
    ours.reset(start)
    theirs.step(torques, 200)
    ours.step(torques, 200)
    found, expected = theirs.state(), ours.state
    moved = np.linalg.norm(expected.ball_position - start.ball_position)
    assert moved > 1e-3
    assert np.linalg.norm((found.ball_position - expected.ball_position)[:2]) < 0.02 * moved
    turned = np.linalg.norm(expected.tilt_components - start.tilt_components)
    assert np.linalg.norm(found.tilt_components - expected.tilt_components) < 0.02 * turned
