"""PyTorch's gradients of a batch equal differences."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import ballbot_rs as bb  # noqa: E402

STEPS = 5


def loss_of(states: "torch.Tensor") -> "torch.Tensor":
    return (states[:, :2] ** 2).sum() + states[:, 16:20].sin().sum() + 0.1 * (states[:, 20:32] ** 2).sum()


def robots(n: int = 3) -> bb.DifferentiableBatch:
    made = bb.DifferentiableBatch(bb.Batch(n, num_threads=1))
    made.reset(list(range(n)))
    return made


@pytest.mark.parametrize(
    ("actuators", "width"),
    [
        ({}, 32),
        ({"delay": 0.01, "strength": (1.0, 0.9, 0.8)}, 35),
        ({"lag": 0.03}, 35),
        ({"delay": 0.016, "lag": 0.02}, 41),
        ({"delay": 0.004}, 35),
    ],
)
def test_gradients_by_torques_equal_differences(actuators, width):
    made = bb.DifferentiableBatch(bb.Batch(3, num_threads=1, actuators=actuators))
    assert made.width == width
    torques = np.random.default_rng(0).uniform(-0.1, 0.1, (STEPS, 3, 3))

    def run(values):
        states, total = made.reset([0, 1, 2]), 0.0
        for step in range(STEPS):
            states, ended = made.step(states, values[step])
            assert not ended.any()
            total = total + loss_of(states)
        return total

    leaf = torch.tensor(torques, requires_grad=True)
    run(leaf).backward()
    for index in [(0, 0, 0), (0, 1, 2), (2, 2, 1), (3, 0, 1)]:
        ends = []
        # Torques are rounded to float32, as actions are.
        for change in (2e-3, -2e-3):
            changed = torques.copy()
            changed[index] += change
            ends.append(float(run(torch.tensor(changed))))
        assert float(leaf.grad[index]) == pytest.approx((ends[0] - ends[1]) / 4e-3, rel=2e-3, abs=1e-3)
    # A command that has yet to arrive has no gradient.
    assert actuators.get("delay", 0.0) < 0.01 or not leaf.grad[-1].any()


def test_second_derivatives_are_an_error():
    made = robots(1)
    torques = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    states, _ = made.step(made.states(), torques)
    (gradient,) = torch.autograd.grad(loss_of(states), torques, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


def test_motors_begin_an_episode_with_nothing_in_transit():
    made = bb.DifferentiableBatch(bb.Batch(4, num_threads=1, actuators={"delay": 0.02, "lag": 0.01}))
    states = made.reset([0, 1, 2, 3])
    for _ in range(300):
        states, ended = made.step(states, torch.full((4, 3), 0.2))
        if ended.any():
            break
    assert ended.any()
    assert not states[ended, 32:].any()
    assert states[~ended, 32:].all()
    assert made.step(states, torch.zeros(4, 3))[0].isfinite().all()


def test_gradients_by_states_equal_differences():
    made = robots(1)
    states = made.states().requires_grad_()
    after, _ = made.step(states, torch.zeros(1, 3))
    loss_of(after).backward()
    batch = bb.Batch(1, num_threads=1)
    batch.reset(seeds=[0])
    found = batch.jacobians(np.zeros((1, 3)), batch.substeps)
    size = 1e-6
    moves = []
    for sign in (1.0, -1.0):
        robot = bb.Ballbot(sim_dt=batch.sim_dt)
        start = batch.state(0)
        spin = np.array([0.0, 0.0, sign * size])
        robot.reset(start.replace(ball_angular_velocity=start.ball_angular_velocity + spin))
        robot.step((0, 0, 0), batch.substeps)
        moves.append(float(loss_of(torch.from_numpy(robot.state.to_array()[None]))))
    assert found.valid.all()
    assert float(states.grad[0, 12]) == pytest.approx((moves[0] - moves[1]) / (2.0 * size), rel=1e-4, abs=1e-6)


def test_a_state_after_an_end_has_no_gradient():
    made = bb.DifferentiableBatch(bb.Batch(4, num_threads=1))
    made.reset([0, 1, 2, 3])
    leaf = torch.full((4, 3), 0.2, dtype=torch.float64, requires_grad=True)
    states = made.states()
    for _ in range(200):
        states, ended = made.step(states, leaf)
        if ended.any():
            break
    assert ended.any()
    gradient = torch.autograd.grad(states[ended].sum(), leaf, retain_graph=True)[0]
    assert not gradient.any()
    states, _ = made.step(states, leaf)
    assert torch.autograd.grad(states.sum(), leaf)[0].isfinite().all()


def test_deviations_are_in_the_heading_frame():
    params = bb.Params.paper()
    for yaw in (0.0, 1.2, -3.0):
        state = bb.State.at_rest(params, tilt=(0.1, -0.2), yaw=yaw)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        state = state.replace(
            ball_position=(*(turn @ (0.3, 0.1)), 0.112),
            ball_velocity=(*(turn @ (0.2, -0.4)), 0.0),
            body_angular_velocity=(0.1, 0.2, 0.3),
        )
        found = bb.DifferentiableBatch.deviations(torch.tensor(state.to_array()[None]))[0].numpy()
        np.testing.assert_allclose(found[[0, 1, 4, 5]], [0.3, 0.1, 0.2, -0.4], atol=1e-12)
        np.testing.assert_allclose(found[6:], [0.1, 0.2, 0.3])
        # Of a rotation vector, from its angle to the sine.
        angle = np.hypot(0.1, 0.2)
        lean = np.array([0.1, -0.2]) @ turn * np.sin(angle) / angle
        np.testing.assert_allclose(found[2:4], lean, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "spatial"}, "model spatial: expected 'contact'"),
        ({"autoreset": "disabled"}, "same_step"),
        ({"actuators": {"speed_limit": 10.0}}, "speed_limit = 10.0: only delay, strength, lag"),
        ({"events": "mild"}, "events that change the motors: actuators.strength, actuators.delay"),
        ({"task": "push"}, "pushes"),
        ({"events": [{"term": "push", "range": [0.0, 1.0], "at": 0.0}]}, "pushes"),
        ({"events": [{"term": "body_mass", "range": [1.0, 2.0], "at": 0.02}]}, "events within an episode: body_mass"),
        (
            {"events": [{"term": "ball_mass", "mode": "interval", "every": [0.1, 0.1], "range": [1.0, 2.0]}]},
            "events within an episode: ball_mass",
        ),
    ],
)
def test_other_batches_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        bb.DifferentiableBatch(bb.Batch(1, **options))


def test_bad_input_is_named():
    made = robots(2)
    states = made.states()
    for torques in (torch.full((2, 3), 9.0), torch.full((2, 3), float("nan")), torch.zeros(1, 3)):
        with pytest.raises(ValueError, match="wheel_torques"):
            made.step(states, torques)
    after, _ = made.step(states, torch.zeros(2, 3))
    for other, message in [(states, "not the current states"), (after[:1], r"states must .* \(2, 32\), not \(1, 32\)")]:
        with pytest.raises(ValueError, match=message):
            made.step(other, torch.zeros(2, 3))


@pytest.mark.parametrize("reentrant", [True, False])
def test_a_checkpoint_of_a_step_is_an_error_that_moves_no_robot(reentrant):
    from torch.utils.checkpoint import checkpoint

    made = robots()
    states, torques = made.states(), torch.zeros((3, 3), dtype=torch.float64, requires_grad=True)
    moved = checkpoint(lambda held: made.step(states, held)[0], torques, use_reentrant=reentrant)
    with pytest.raises(ValueError, match="not the current states"):
        moved.sum().backward()
    np.testing.assert_array_equal(made.states(), moved.detach())


def test_a_checkpoint_of_a_policy_keeps_the_gradient():
    from torch.utils.checkpoint import checkpoint

    found = []
    for kept in (False, True):
        made, gain = robots(), torch.full((9, 3), 0.01, dtype=torch.float64, requires_grad=True)
        policy = lambda states, gain=gain: torch.tanh(bb.DifferentiableBatch.deviations(states) @ gain)  # noqa: E731
        states = made.states()
        for _ in range(3):
            torques = checkpoint(policy, states, use_reentrant=False) if kept else policy(states)
            states, _ = made.step(states, 0.1 * torques)
        loss_of(states).backward()
        found.append(gain.grad)
    assert found[0].any()
    torch.testing.assert_close(found[1], found[0], rtol=0.0, atol=0.0)
