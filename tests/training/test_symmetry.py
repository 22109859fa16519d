"""The symmetries of a robot: turned or mirrored torques make a turned or mirrored motion, in every row."""

import math

import numpy as np
import pytest
import torch
from sb3_contrib import RecurrentPPO

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs.training import config, teacher, tied
from ballbot_rs.training.symmetry import linear_policies, of_batch, opposite, symmetries
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


def asymmetry(model, of_values=False):
    """Root mean square of what differs between turned and mirrored robots: their actions, or values."""
    names = tuple(row["name"] for row in TASKS["balance"]["observation"])
    seen = np.random.default_rng(1).normal(0.0, 0.05, (200, len(names)))

    def out(observations):
        given = torch.as_tensor(observations, dtype=torch.float32)
        with torch.no_grad():
            return (model.policy.predict_values(given) if of_values else teacher._actions(model, given)).numpy()

    differences = [
        out(seen @ of_rows) - (out(seen) if of_values else out(seen) @ of_wheels)
        for of_rows, of_wheels in symmetries(names, 1)
    ]
    return np.sqrt(np.square(differences).mean())


def test_tied_policies_stay_symmetric_while_they_learn():
    free, even = (new_model(net_arch=(12, 18)) for _ in range(2))
    ties = tied.tie(even, True, pytest.fail)
    for model in (free, even):
        law = teacher.laws_of(model, FIT)[0]
        before = teacher._actor(model)[0].detach().clone()
        teacher.fit_actor(model, law, FIT, 0, ties if model is even else None)
        assert (teacher._actor(model)[0] - before).abs().max() > 0.01
        model.learn(model.n_envs * model.n_steps)
    assert asymmetry(even) < 1e-6 < 1e-3 < asymmetry(free)
    assert asymmetry(even, of_values=True) < 1e-5 < 1e-3 < asymmetry(free, of_values=True)
    assert even.policy.log_std.unique().numel() == 1 < free.policy.log_std.unique().numel()


def test_an_odd_policy_answers_the_opposite_motion_with_reversed_torques_while_it_learns():
    one_sided, odd = (new_model(net_arch=(12, 18)) for _ in range(2))
    names = tuple(row["name"] for row in TASKS["balance"]["observation"])
    seen = torch.as_tensor(np.random.default_rng(1).normal(0.0, 0.5, (200, len(names))), dtype=torch.float32)
    reversed_ = seen @ torch.as_tensor(opposite(names, 1), dtype=torch.float32)
    evenness = []
    for model in (one_sided, odd):
        ties = tied.tie(model, True, pytest.fail, odd=model is odd)
        law = teacher.laws_of(model, FIT)[0]
        before = teacher._actor(model)[0].detach().clone()
        teacher.fit_actor(model, law, FIT, 0, ties)
        assert (teacher._actor(model)[0] - before).abs().max() > 0.01
        model.learn(model.n_envs * model.n_steps)
        assert asymmetry(model) < 1e-6
        with torch.no_grad():
            evenness.append((teacher._actions(model, seen) + teacher._actions(model, reversed_)).square().mean().sqrt())
    assert evenness[1] < 1e-6 < 1e-3 < evenness[0]
    assert all(not parameter.any() for parameter in teacher._actor(odd) if parameter.ndim == 1)


def test_a_robot_moves_the_opposite_way_where_motions_are_small():
    rows = tuple(row["name"] for row in TASKS["balance"]["observation"])
    batch = bb.Batch(1, scale_observations=False, history=2, autoreset="disabled")
    actions = np.random.default_rng(0).uniform(-1e-3, 1e-3, (40, 3)).astype(np.float32)

    def motion(sign):
        start = bb.State.at_equilibrium(bb.Params.paper(), tilt=tuple(sign * 0.01 * TILT))
        first = batch.reset(starts=[start])[0]
        return np.array([first, *(batch.step(sign * action[None])[0][0] for action in actions)])

    one, other = motion(1.0), motion(-1.0)
    assert np.abs(one - other).max() > 1e-2
    np.testing.assert_allclose(other, one @ opposite(rows, 2), atol=1e-4)


def test_the_opposite_motion_has_the_same_vertical_and_distances():
    rows = ("gravity direction, body z", "body rate about body z", "distance of the goal", "wheel speed 1")
    np.testing.assert_array_equal(opposite(rows, 2), np.diag(2 * [1.0, -1.0, 1.0, -1.0]))


def test_what_is_not_odd_is_named():
    model = new_model(net_arch=(6,))
    model.policy.mlp_extractor.policy_net[1] = torch.nn.ReLU()
    with pytest.raises(ValueError, match=r"symmetric = true, odd = true: the activation function is ReLU\(\)"):
        tied.tie(model, True, pytest.fail, odd=True)
    cells = {"lstm_hidden_size": 6, "net_arch": []}
    recurrent = RecurrentPPO("MlpLstmPolicy", bb.BallbotVecEnv(8, model="spatial"), n_steps=8, policy_kwargs=cells)
    with pytest.raises(ValueError, match="symmetric = true, odd = true: LSTM cells are not odd"):
        tied.tie(recurrent, True, pytest.fail, odd=True)
    with pytest.raises(ValueError, match="odd = true with algorithm = 'PPO', symmetric = 'auto': expected"):
        config.TrainConfig(symmetric="auto", odd=True)
    with pytest.raises(ValueError, match="odd = true with algorithm = 'RecurrentPPO', symmetric = True: expected"):
        config.TrainConfig(algorithm="RecurrentPPO", symmetric=True, odd=True)
    with pytest.raises(ValueError, match="odd = 1 must be true or false"):
        config.TrainConfig(odd=1)


def test_ties_keep_the_size_of_new_weights():
    free, even = (new_model(net_arch=(60, 60)) for _ in range(2))
    tied.tie(even, True, pytest.fail)
    for before, after in zip(teacher._actor(free)[:4:2], teacher._actor(even)[:4:2], strict=True):
        assert 0.8 < after.std() / before.std() < 1.2


@pytest.mark.parametrize(
    "critic", [{}, {"enable_critic_lstm": False}, {"enable_critic_lstm": False, "shared_lstm": True}]
)
def test_tied_recurrent_policies_are_symmetric_over_time(critic):
    env = bb.BallbotVecEnv(8, model="spatial", num_threads=1)
    model = RecurrentPPO(
        "MlpLstmPolicy",
        env,
        n_steps=16,
        batch_size=64,
        learning_rate=0.03,
        policy_kwargs={"lstm_hidden_size": 12, "n_lstm_layers": 2, "net_arch": [6], **critic},
        seed=0,
    )
    tied.tie(model, True, pytest.fail)
    model.learn(2 * 8 * 16)
    names = tuple(row["name"] for row in TASKS["balance"]["observation"])
    seen = np.random.default_rng(1).normal(0.0, 1.0, (12, 5, len(names))).astype(np.float32)

    def actions(observations):
        state, start, found = None, np.ones(5, dtype=bool), []
        for step in observations:
            action, state = model.predict(step, state, start, deterministic=True)
            found.append(action)
            start = np.zeros(5, dtype=bool)
        return np.array(found)

    for of_rows, of_wheels in symmetries(names, 1):
        np.testing.assert_allclose(actions((seen @ of_rows).astype(np.float32)), actions(seen) @ of_wheels, atol=1e-5)
    assert np.abs(actions(seen)).max() > 0.1


UNEVEN = bb.Params.paper().replace(wheel_azimuths=(0.0, 2.0, 4.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robot": UNEVEN}, "the robot has a preferred side: its body or wheels differ"),
        ({"robot": bb.Params.paper().replace(body_com_offset=(0.01, 0.0))}, "the robot has a preferred side: its body"),
        ({"robot": bb.Params.paper().replace(floor_tilt=(0.01, 0.0))}, "the robot has a preferred side: floor_tilt"),
        ({"actuators": {"strength": [0.7, 1.0, 1.2]}}, "the robot has a preferred side: actuators.strength"),
        ({"lidar": {}}, "instruments"),
        ({"net_arch": (6, 7)}, "a hidden layer of 7 units: expected a multiple of 6"),
    ],
)
def test_what_has_no_symmetry_is_named(options, message):
    with pytest.raises(ValueError, match=f"symmetric = true: {message}"):
        tied.tie(new_model(**{"net_arch": (6,), **options}), True, pytest.fail)
    told = []
    assert tied.tie(new_model(**{"net_arch": (6,), **options}), "auto", told.append) is None
    assert message in told[0]


def test_several_robots_have_no_preferred_side_on_average():
    robots = [bb.Params.paper().replace(body_com_offset=(side, 0.0)) for side in (0.01, -0.01)]
    assert tied.tie(new_model(net_arch=(6,), robot=robots), True, pytest.fail) is not None


def test_azimuths_may_be_negative():
    third = 2.0 * math.pi / 3.0
    robot = bb.Params.paper().replace(wheel_azimuths=(0.0, third, -third))
    assert tied.tie(new_model(net_arch=(6,), robot=robot), True, pytest.fail) is not None


def test_weights_of_a_checkpoint_must_be_tied_already():
    """Weights from a loop that does not tie them would be replaced by their mean at the first update."""
    model, told = new_model(net_arch=(6,)), []
    before = teacher._actor(model)[0].detach().clone()
    assert tied.tie(model, "auto", told.append, is_new=False) is None
    assert "the weights of the checkpoint are not tied" in told[0]
    assert torch.equal(teacher._actor(model)[0], before)
    with pytest.raises(ValueError, match="symmetric = true: the weights of the checkpoint are not tied"):
        tied.tie(model, True, pytest.fail, is_new=False)
    tied.tie(model, True, pytest.fail)
    assert tied.tie(model, True, pytest.fail, is_new=False) is not None
    with pytest.raises(ValueError, match="symmetric = true, odd = true: the weights of the checkpoint are not tied"):
        tied.tie(model, True, pytest.fail, odd=True, is_new=False)
    tied.tie(model, True, pytest.fail, odd=True)
    assert tied.tie(model, True, pytest.fail, odd=True, is_new=False) is not None


def test_algorithms_without_symmetric_policies_are_named():
    with pytest.raises(ValueError, match="symmetric = true: SAC has no such policies, only PPO and RecurrentPPO"):
        config.TrainConfig(algorithm="SAC", symmetric=True)
    with pytest.raises(ValueError, match="symmetric = 1 must be true, false or 'auto'"):
        config.TrainConfig(symmetric=1)


def test_several_robots_have_a_law_each():
    with pytest.raises(ValueError, match=r"teacher\.drawn = False: with several robots"):
        teacher.laws_of(new_model(robot=["paper", "kugle"]), config.Teacher("lqr"))
