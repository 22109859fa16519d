"""JAX's gradients of a batch equal differences and PyTorch's gradients, compiled or not."""

import numpy as np
import pytest

jax = pytest.importorskip("jax")

import jax.numpy as jnp  # noqa: E402

import ballbot_rs as bb  # noqa: E402

STEPS = 5
TORQUES = np.random.default_rng(0).uniform(-0.1, 0.1, (STEPS, 3, 3))


@pytest.fixture(autouse=True)
def _float64():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@jax.jit
def loss_of(states):
    return (states[:, :2] ** 2).sum() + jnp.sin(states[:, 16:20]).sum() + 0.1 * (states[:, 20:32] ** 2).sum()


@pytest.fixture
def robots():
    return bb.DifferentiableJaxBatch(bb.Batch(3, num_threads=1))


def scanned(robots):
    """The loss of motions from given states under given torques, by `jax.lax.scan`."""

    def loss(torques, states):
        def move(states, held):
            states, ended = robots.step(states, held)
            return states, (loss_of(states), ended)

        _, (losses, ended) = jax.lax.scan(move, states, torques)
        return losses.sum(), ended

    return loss


def test_gradients_of_a_scan_equal_differences(robots):
    run = jax.jit(jax.value_and_grad(scanned(robots), argnums=(0, 1), has_aux=True))
    (_, ended), (by_torques, by_states) = run(TORQUES, robots.reset([0, 1, 2]))
    assert not ended.any()
    for index in [(0, 0, 0), (0, 1, 2), (2, 2, 1), (4, 0, 1)]:
        ends = []
        # Torques are rounded to float32, as actions are.
        for change in (2e-3, -2e-3):
            changed = TORQUES.copy()
            changed[index] += change
            ends.append(float(run(changed, robots.reset([0, 1, 2]))[0][0]))
        assert float(by_torques[index]) == pytest.approx((ends[0] - ends[1]) / 4e-3, rel=2e-3, abs=1e-3)
    assert by_states.shape == (3, 32)
    assert by_states.any(axis=1).all()


def test_gradients_are_pytorchs_compiled_or_not(robots):
    torch = pytest.importorskip("torch")
    other = bb.DifferentiableBatch(bb.Batch(3, num_threads=1))
    leaf = torch.tensor(TORQUES, requires_grad=True)
    start = states = other.reset([0, 1, 2]).requires_grad_()
    total = 0.0
    for held in leaf:
        states, _ = other.step(states, held)
        total = total + (states[:, :2] ** 2).sum() + states[:, 16:20].sin().sum() + 0.1 * (states[:, 20:32] ** 2).sum()
    total.backward()

    def loop(torques, states):
        total = 0.0
        for held in torques:
            states, _ = robots.step(states, held)
            total = total + loss_of(states)
        return total, None

    for loss in (loop, scanned(robots), jax.jit(loop)):
        found = jax.grad(loss, argnums=(0, 1), has_aux=True)(jnp.array(TORQUES), robots.reset([0, 1, 2]))[0]
        for ours, theirs in zip(found, (leaf.grad, start.grad), strict=True):
            np.testing.assert_allclose(ours, theirs.numpy(), rtol=1e-12, atol=1e-14)
        np.testing.assert_array_equal(robots.states(), states.detach().numpy())


def test_forward_mode_is_reverse_mode(robots):
    change = np.random.default_rng(1).normal(size=(3, 3))
    moved = lambda torques: robots.step(robots.reset([0, 1, 2]), torques)[0]  # noqa: E731
    _, forward = jax.jvp(moved, (TORQUES[0],), (change,))
    _, reverse = jax.vjp(moved, TORQUES[0])
    weights = np.random.default_rng(2).normal(size=(3, 32))
    assert float((weights * forward).sum()) == pytest.approx(float((reverse(weights)[0] * change).sum()), rel=1e-12)


def test_a_state_after_an_end_has_no_gradient(robots):
    def moved(torques, states):
        states, ended = robots.step(states, torques)
        return states.sum(), (states, ended)

    step = jax.jit(jax.grad(moved, has_aux=True))
    states, pushed = robots.reset([0, 1, 2]), jnp.full((3, 3), 0.2)
    for _ in range(200):
        gradient, (states, ended) = step(pushed, states)
        if ended.any():
            break
    assert ended.any()
    assert not gradient[ended].any()
    assert gradient[~ended].any()
    gradient, _ = step(pushed, states)
    assert jnp.isfinite(gradient).all()
    assert gradient[ended].any()


def test_deviations_are_pytorchs(robots):
    torch = pytest.importorskip("torch")
    states = robots.reset([0, 1, 2])
    theirs = bb.DifferentiableBatch.deviations(torch.tensor(np.array(states)))
    np.testing.assert_allclose(robots.deviations(states), theirs.numpy(), rtol=0.0, atol=1e-15)


def test_bad_input_is_named(robots):
    states = robots.reset()
    for torques in (np.full((3, 3), 9.0), np.full((3, 3), np.nan), np.zeros((1, 3))):
        with pytest.raises(ValueError, match="wheel_torques"):
            robots.step(states, torques)
    after, _ = robots.step(states, np.zeros((3, 3)))
    for step in (robots.step, jax.jit(robots.step)):
        with pytest.raises(ValueError, match=r"states must have the shape \(3, 32\), not \(1, 32\)"):
            step(after[:1], np.zeros((3, 3)))
    with pytest.raises(ValueError, match="not the current states"):
        robots.step(states, np.zeros((3, 3)))
    with pytest.raises(jax.errors.JaxRuntimeError, match="not the current states"):
        jax.jit(robots.step)(states, np.zeros((3, 3)))
    # What failed did not move the robots.
    jax.jit(robots.step)(after, np.zeros((3, 3)))
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(ValueError, match="jax_enable_x64"):
        robots.reset()


def test_derivatives_are_mapped_but_not_the_step(robots):
    moved = lambda torques: robots.step(states, torques)[0]  # noqa: E731
    found = []
    for jacobian in (jax.jacfwd, jax.jacrev, lambda function: jax.jit(jax.jacrev(function))):
        states = robots.reset([0, 1, 2])
        found.append(jacobian(moved)(TORQUES[0]))
        np.testing.assert_allclose(found[-1], found[0], rtol=1e-12, atol=1e-14)
    states = robots.reset([0, 1, 2])
    for step in (moved, jax.jit(moved), jax.grad(lambda torques: moved(torques).sum())):
        with pytest.raises(ValueError, match=r"jax.vmap of DifferentiableJaxBatch.step over 5 arrays"):
            jax.vmap(step)(jnp.array(TORQUES))
    with pytest.raises(NotImplementedError, match="checkpoint"):
        jax.grad(jax.checkpoint(lambda torques: moved(torques).sum()))(TORQUES[0])
    # What failed did not move the robots.
    np.testing.assert_array_equal(robots.states(), states)
