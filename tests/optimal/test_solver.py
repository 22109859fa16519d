"""The optimizer's parts: differences of states, costs, the quadratic program, the backward sweep."""

import itertools

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._quaternions import product
from ballbot_rs.optimal import solver, tangent
from ballbot_rs.optimal.cost import Quadratic


def rotation(vector: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation vector."""
    angle = np.linalg.norm(vector)
    return np.concatenate([[np.cos(0.5 * angle)], 0.5 * np.sinc(0.5 * angle / np.pi) * vector])


def moved(row: np.ndarray, change: np.ndarray) -> np.ndarray:
    """A state, changed in the coordinates of `Jacobian.states`."""
    out = row.copy()
    for coordinate, number in [(0, 0), (6, 13), (12, 26), (15, 7), (18, 10), (21, 20), (24, 23), (27, 29)]:
        out[number : number + 3] += change[coordinate : coordinate + 3]
    out[3:7] = product(rotation(change[3:6]), row[3:7])
    out[16:20] = product(row[16:20], rotation(change[9:12]))
    return out


def test_a_difference_undoes_a_change():
    rng = np.random.default_rng(0)
    row = bb.State.at_rest(bb.Params.paper(), tilt=(0.2, -0.1), yaw=2.0).to_array()
    for _ in range(100):
        change = rng.uniform(-1.0, 1.0, 30)
        np.testing.assert_allclose(tangent.difference(moved(row, change), row), change, atol=1e-12)
    # Both signs of a quaternion are the same attitude.
    other = row.copy()
    other[16:20] *= -1.0
    np.testing.assert_allclose(tangent.difference(other, row), 0.0, atol=1e-15)


def test_a_motion_has_the_derivatives_of_its_steps():
    robot = bb.Ballbot("kugle")
    robot.push((0.4, 0.1, 0.0))
    plant = solver.Plant(robot, 10, 1.0, 0.1)
    torques = np.random.default_rng(1).uniform(-0.2, 0.2, (6, 3))
    motion = plant.motion(lambda k, _: torques[k], 6)
    found = plant.derivatives(motion)
    step, size = 1e-6, 3
    for column in range(3):
        ends = []
        for sign in (1.0, -1.0):
            changed = torques.copy()
            changed[size, column] += sign * step
            other = plant.motion(lambda k, _, torques=changed: torques[k], 6)
            ends.append((tangent.difference(other.states, motion.states), other.forces))
        states, forces = ((high - low) / (2.0 * step) for high, low in zip(*ends, strict=True))
        np.testing.assert_allclose(states[size + 1], found.b[size, :, column], atol=1e-5)
        np.testing.assert_allclose(states[size + 2], found.a[size + 1] @ found.b[size, :, column], atol=1e-5)
        np.testing.assert_allclose(forces[size], found.d[size, :, column], rtol=1e-4, atol=2e-3)


def test_the_cost_has_its_gradients():
    robot = bb.Ballbot()
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.05, -0.02)))
    plant = solver.Plant(robot, 10, 5.0, 0.1)
    torques = np.random.default_rng(2).uniform(-0.2, 0.2, (5, 3))
    motion = plant.motion(lambda k, _: torques[k], 5)
    weights = np.random.default_rng(3).uniform(0.5, 2.0, (6, 30))
    # Nothing depends on the attitude of the ball.
    weights[:, 3:6] = 0.0
    targets = np.repeat(bb.State.at_rest(robot.params, tilt=(-0.3, 0.4), yaw=0.5).to_array()[None], 6, axis=0)
    cost = Quadratic(targets, weights, 3.0, 0.2, 0.1)
    assert (np.abs(motion.forces[:, 3:6]) > 0.1 * motion.forces[:, :3]).any(), "the limit of traction matters"
    expansion = cost.expand(motion, plant.derivatives(motion))
    found = solver.sweep(plant.derivatives(motion), expansion, -torques - 5.0, 5.0 - torques, 0.0)

    # Of the whole motion by its torques: what the sweep's gradients add up to.
    gradient = np.empty_like(torques)
    for index in np.ndindex(torques.shape):
        totals = []
        for sign in (1.0, -1.0):
            changed = torques.copy()
            changed[index] += sign * 1e-5
            totals.append(cost.total(plant.motion(lambda k, _, torques=changed: torques[k], 5)))
        gradient[index] = (totals[0] - totals[1]) / 2e-5
    a, b = plant.derivatives(motion).a, plant.derivatives(motion).b
    value, own = expansion.x[5], np.empty_like(torques)
    for k in reversed(range(5)):
        own[k] = expansion.u[k] + value @ b[k]
        value = expansion.x[k] + value @ a[k]
    np.testing.assert_allclose(own, gradient, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())
    assert found.first < 0.0 < found.second < -found.first


def test_the_quadratic_program_has_the_least_of_all_faces():
    rng = np.random.default_rng(4)
    for _ in range(300):
        root = rng.normal(size=(3, 3))
        hessian, gradient = root @ root.T + 0.01 * np.eye(3), rng.normal(size=3)
        low, high = -rng.uniform(0.0, 1.0, 3), rng.uniform(0.0, 1.0, 3)
        best = np.inf
        for face in itertools.product((0, 1, 2), repeat=3):
            held = np.array(face) > 0
            x = np.where(np.array(face) == 1, low, high)
            free = ~held
            if free.any():
                right = gradient[free] + hessian[np.ix_(free, held)] @ x[held]
                x[free] = -np.linalg.solve(hessian[np.ix_(free, free)], right)
            if (x >= low - 1e-12).all() and (x <= high + 1e-12).all():
                best = min(best, 0.5 * x @ hessian @ x + gradient @ x)
        x, free = solver.limited(hessian, gradient, low, high)
        assert (x >= low).all()
        assert (x <= high).all()
        assert 0.5 * x @ hessian @ x + gradient @ x == pytest.approx(best, abs=1e-9)
        assert not np.abs((gradient + hessian @ x)[free]).max(initial=0.0) > 1e-6
    assert solver.limited(-np.eye(3), np.ones(3), -np.ones(3), np.ones(3)) is None


def test_a_linear_robot_takes_one_sweep():
    """The change of the torques is the exact optimum of a quadratic cost of a linear motion."""
    rng = np.random.default_rng(5)
    n, steps = 30, 8
    a, b = 0.3 * rng.normal(size=(steps, n, n)), rng.normal(size=(steps, n, 3))
    derivatives = solver.Derivatives(a, b, np.zeros((steps, 9, n)), np.zeros((steps, 9, 3)))
    x, xx = rng.normal(size=(steps + 1, n)), np.repeat(np.eye(n)[None], steps + 1, axis=0)
    u, uu = rng.normal(size=(steps, 3)), np.repeat(np.eye(3)[None], steps, axis=0)
    expansion = solver.Expansion(x, xx, u, uu, np.zeros((steps, 3, n)))
    far = np.full((steps, 3), 1e9)
    found = solver.sweep(derivatives, expansion, -far, far, 0.0)

    # All states as a linear function of all torques.
    map_ = np.zeros((steps + 1, n, 3 * steps))
    for k in range(steps):
        map_[k + 1] = a[k] @ map_[k]
        map_[k + 1, :, 3 * k : 3 * k + 3] += b[k]
    flat = map_.reshape(-1, 3 * steps)
    best = -np.linalg.solve(flat.T @ flat + np.eye(3 * steps), flat.T @ x.ravel() + u.ravel()).reshape(steps, 3)
    change, state = np.empty((steps, 3)), np.zeros(n)
    for k in range(steps):
        change[k] = found.changes[k] + found.gains[k] @ state
        state = a[k] @ state + b[k] @ change[k]
    np.testing.assert_allclose(change, best, atol=1e-9)
