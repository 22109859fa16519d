"""The symmetries of a robot: turned or mirrored torques make a turned or mirrored motion, in every row."""

import dataclasses

import numpy as np
import pytest
import torch

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs.training import config, teacher
from ballbot_rs.training.symmetry import linear_policies, of_batch, symmetries
from tests.training.test_teacher import FIT, new_model

TILT, YAW = np.array([0.03, -0.05]), 0.7
TURN = 2.0 * np.pi / 3.0


@pytest.mark.parametrize("ages", [1, 3])
def test_a_robot_moves_turned_or_mirrored(ages):
    rows = tuple(row["name"] for row in TASKS["balance"]["observation"])
    batch = bb.Batch(1, scale_observations=False, history=ages, autoreset="disabled")
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3)).astype(np.float32)

    def motion(tilt, yaw, actions):
        start = bb.State.at_equilibrium(bb.Params.paper(), tilt=tuple(tilt), yaw=yaw)
        first = batch.reset(starts=[start])[0]
        return np.array([first, *(batch.step(action[None])[0][0] for action in actions)])

    original = motion(TILT, YAW, actions)
    found = symmetries(rows, ages)
    assert len(found) == 6
    for i, (of_rows, of_wheels) in enumerate(found):
        turns, is_mirrored = divmod(i, 2)
        cos, sin = np.cos(turns * TURN), np.sin(turns * TURN)
        tilt = np.array([[cos, -sin], [sin, cos]]) @ (TILT * [-1.0, 1.0] if is_mirrored else TILT)
        changed = motion(tilt, -YAW if is_mirrored else YAW, (actions @ of_wheels).astype(np.float32))
        np.testing.assert_allclose(changed, original @ of_rows, atol=1e-5)
        if i > 0:
            assert np.abs(changed - original).max() > 0.1


def test_a_row_without_symmetry_is_named():
    with pytest.raises(ValueError, match="the row 'charge' is neither"):
        symmetries(("charge",), 1)


def test_a_mirror_reverses_turns():
    rows = ("commanded rate of the heading", "distance of the goal")
    for turns in range(3):
        (kept, _), (mirrored, _) = symmetries(rows, 1)[2 * turns : 2 * turns + 2]
        np.testing.assert_array_equal(kept, np.eye(2))
        np.testing.assert_array_equal(mirrored, np.diag([-1.0, 1.0]))


@pytest.mark.parametrize("task", sorted(TASKS))
def test_linear_policies_turn_and_mirror_with_the_robot(task):
    pairs = of_batch(bb.Batch(1, task))
    basis = linear_policies(pairs)
    seen = np.random.default_rng(3).standard_normal((5, basis.shape[2]))
    for of_rows, of_wheels in pairs:
        np.testing.assert_allclose(seen @ of_rows @ basis.mT, seen @ basis.mT @ of_wheels, atol=1e-12)
    flat = basis.reshape(len(basis), -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(len(basis)), atol=1e-12)
    # There are no others: the pairs make the rest of a policy zero.
    n = basis.shape[2]
    conditions = [np.kron(np.eye(3), of_rows) - np.kron(of_wheels.T, np.eye(n)) for of_rows, of_wheels in pairs]
    assert len(basis) == 3 * n - np.linalg.matrix_rank(np.vstack(conditions))


def test_a_symmetric_fit_makes_a_symmetric_policy():
    names = tuple(row["name"] for row in TASKS["balance"]["observation"])
    seen = np.random.default_rng(1).normal(0.0, 0.05, (200, len(names))).astype(np.float32)

    def asymmetry(symmetric):
        model = new_model()
        fit = dataclasses.replace(FIT, symmetric=symmetric)
        teacher.fit_actor(model, teacher.laws_of(model, fit)[0], fit, 0)

        def act(observations):
            with torch.no_grad():
                return teacher._actions(model, torch.as_tensor(observations)).numpy()

        differences = [
            act((seen @ of_rows).astype(np.float32)) - act(seen) @ of_wheels
            for of_rows, of_wheels in symmetries(names, 1)
        ]
        return np.sqrt(np.square(differences).mean())

    assert asymmetry(True) < 0.85 * asymmetry(False)


def test_what_has_no_symmetry_is_rejected():
    fit = config.Teacher("lqr", symmetric=True)
    uneven = bb.Params.paper().replace(wheel_azimuths=(0.0, 2.0, 4.0))
    with pytest.raises(ValueError, match=r"teacher\.symmetric = True: the wheels of robot 0 are not alike"):
        teacher.laws_of(new_model(robot=uneven), fit)
    with pytest.raises(ValueError, match=r"teacher\.symmetric = True: instruments"):
        teacher.laws_of(new_model(lidar={}), fit)


def test_several_robots_have_a_law_each():
    with pytest.raises(ValueError, match=r"teacher\.drawn = False: with several robots"):
        teacher.laws_of(new_model(robot=["paper", "kugle"]), config.Teacher("lqr"))
