"""Derivatives of the models without slip, `spatial` and `planar`."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.envs.family import sample_robots

#: The parts of a state that are independent without slip, in the order of `Jacobian.states`, and their sizes.
PARTS = {
    "ball_position": 2,
    "ball_rotation": 3,
    "body_rotation": 3,
    "wheel_angle": 3,
    "ball_velocity": 2,
    "ball_angular_velocity": 1,
    "body_angular_velocity": 3,
}


def quaternion(rotation):
    angle = np.linalg.norm(rotation)
    return np.array([np.cos(angle / 2), *(np.sinc(angle / 2 / np.pi) / 2 * rotation)])


def product(a, b):
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def rotation_between(a, b, in_body):
    inverse = np.array(b) * (1, -1, -1, -1)
    turn = product(inverse, a) if in_body else product(a, inverse)
    return 2 * turn[1:] * np.sign(turn[0])


def moved(params, state, change):
    """A state without slip, changed along the coordinates of `Jacobian.states`."""
    position, ball, body, angles, velocity, spin, rate = np.split(change, np.cumsum(list(PARTS.values()))[:-1])
    rolling = bb.State.rolling(
        params,
        state.ball_velocity[:2] + velocity,
        product(state.body_quaternion, quaternion(body)),
        state.body_angular_velocity + rate,
        state.ball_angular_velocity[2] + spin[0],
    )
    place = (*(state.ball_position[:2] + position), params.ball_radius)
    return rolling.replace(
        ball_position=place,
        body_position=place,
        ball_quaternion=product(quaternion(ball), state.ball_quaternion),
        wheel_angles=state.wheel_angles + angles,
    )


def end(robot, before):
    """The change from a state, and the contact forces."""
    state, contacts = robot.state, robot.contacts
    return np.concatenate(
        [
            state.ball_position[:2] - before.ball_position[:2],
            rotation_between(state.ball_quaternion, before.ball_quaternion, in_body=False),
            rotation_between(state.body_quaternion, before.body_quaternion, in_body=True),
            state.wheel_angles - before.wheel_angles,
            state.ball_velocity[:2] - before.ball_velocity[:2],
            state.ball_angular_velocity[2:] - before.ball_angular_velocity[2:],
            state.body_angular_velocity - before.body_angular_velocity,
            contacts.wheel_normal_forces,
            contacts.wheel_tractions,
            contacts.floor_force,
        ]
    )


class Case:
    """A moving robot with its derivatives, and their differences."""

    def __init__(self, model, seed, steps, parameters=(), **changes):
        rng = np.random.default_rng(seed)
        self.model, self.steps = model, steps
        self.params = sample_robots(1, seed)[0].replace(roller_ripple=0.0, **changes)
        if model == "planar":
            self.params = self.params.replace(body_com_offset=(0, 0), wheel_zenith_offsets=(0, 0, 0))
        robot = bb.Ballbot(self.params, model)
        robot.reset(bb.State.at_rest(self.params, tilt=rng.uniform(-0.3, 0.3, 2), yaw=rng.uniform(-3, 3)))
        robot.push(rng.uniform(-0.3, 0.3, 3) * self.params.body_mass, (0.02, 0.01, 0.1))
        self.torques = rng.uniform(-0.2, 0.2, 3) * self.params.max_wheel_torque
        robot.step(self.torques, 30)
        self.start = robot.state
        self.jacobian = robot.jacobian(self.torques, steps, parameters)

    def after(self, change=None, torques=0.0, **changes):
        params = self.params.replace(**changes)
        robot = bb.Ballbot(params, self.model)
        robot.reset(moved(params, self.start, np.zeros(17) if change is None else change))
        robot.step(self.torques + torques, self.steps)
        return end(robot, self.jacobian.state)

    def worst(self, function, step, exact, alike):
        """Largest error of a derivative, relative to the largest of its kind.

        Of three steps: dry friction changes within 0.05 rad/s, and rounding spoils smaller steps.
        """
        kinds = (slice(0, 11), slice(11, 17), slice(17, 26))
        errors = []
        for h in (10 * step, step, 1e-2 * step):
            near, far = ((function(k * h) - function(-k * h)) / (2 * k * h) for k in (1, 2))
            deviation = np.abs((4 * near - far) / 3 - exact)
            errors.append(max(deviation[rows].max() / max(np.abs(alike[rows]).max(), 1e-3) for rows in kinds))
        return min(errors)


def rows(of_states, of_forces):
    return np.vstack([of_states, of_forces])


@pytest.mark.parametrize("model", ["spatial", "planar"])
@pytest.mark.parametrize("steps", [1, 25])
def test_derivatives_equal_differences(model, steps):
    worst = []
    names = ["body_mass", "ball_mass", "wheel_radius", "gravity"]
    for seed in range(6):
        case = Case(model, seed, steps, names)
        params, jacobian = case.params, case.jacobian
        exact = rows(jacobian.A, jacobian.C)
        for i, unit in enumerate(np.eye(17)):
            worst.append(case.worst(lambda h, u=unit, c=case: c.after(h * u), 1e-3, exact[:, i], exact))
        exact = rows(jacobian.B, jacobian.D)
        for i, unit in enumerate(np.eye(3)):
            step = 1e-3 * params.max_wheel_torque
            worst.append(case.worst(lambda h, u=unit, c=case: c.after(torques=h * u), step, exact[:, i], exact))
        exact = rows(jacobian.P, jacobian.Q)
        for i, name in enumerate(names):
            value = getattr(params, name)
            changed = lambda h, c=case, n=name, v=value: c.after(**{n: v + h})  # noqa: E731
            worst.append(case.worst(changed, 1e-3 * value, exact[:, i], exact[:, i : i + 1]))
    print(f"{model}, {steps} steps: largest error {max(worst):.1e}, median {np.median(worst):.1e}")
    assert max(worst) < 1e-8


@pytest.mark.parametrize("name", ["wheel_coulomb_friction", "floor_rolling_friction", "floor_spinning_friction"])
def test_a_friction_of_zero_has_the_derivatives_of_a_small_one(name):
    case = Case("spatial", 1, 1, [name], wheel_coulomb_friction=0.0)
    found = (4 * case.after(**{name: 1e-6}) - case.after(**{name: 2e-6}) - 3 * case.after()) / 2e-6
    exact = rows(case.jacobian.P, case.jacobian.Q)[:, 0]
    assert exact.any()
    np.testing.assert_allclose(found, exact, atol=1e-5 * np.abs(exact).max())


@pytest.mark.parametrize("seed", [None, 38, 41, 49])
def test_products_of_inertia_of_small_bodies_have_derivatives(seed):
    """A difference keeps their inertia positive definite."""
    params = bb.Params.paper() if seed is None else sample_robots(60, seed=11)[seed].replace(wheel_coulomb_friction=0.0)
    name = "body_products_of_inertia"
    robot = bb.Ballbot(params, "spatial")
    start = bb.State.rolling(params, (0.1, -0.2), quaternion(np.array([0.1, -0.05, 0.3])), (0.3, 0.2, 0.5), 0.1)
    robot.reset(start)
    jacobian = robot.jacobian((0.01, -0.02, 0.01), 5, [name])
    for element in range(3):

        def after(change, element=element):
            value = np.array(params.body_products_of_inertia)
            value[element] += change
            changed = bb.Ballbot(params.replace(**{name: value}), "spatial")
            changed.reset(start)
            changed.step((0.01, -0.02, 0.01), 5)
            return end(changed, jacobian.state)

        h = 1e-3 * min(params.body_inertia)
        near, far = ((after(k * h) - after(-k * h)) / (2 * k * h) for k in (1, 2))
        exact = rows(jacobian.P, jacobian.Q)[:, element]
        np.testing.assert_allclose((4 * near - far) / 3, exact, atol=1e-7 * max(np.abs(exact).max(), 1e-3))


@pytest.mark.parametrize("preset", ["paper", "kugle", "rezero", "asroballet"])
def test_at_rest_it_is_the_linear_model(preset):
    params = bb.Params.preset(preset).replace(wheel_coulomb_friction=0.0)
    dt = 0.002
    found_a, found_b = bb.Ballbot(params, "spatial", dt).jacobian((0, 0, 0)).rolling()
    # Without angular momentum about the vertical the spin of the ball, the last state of rolling, follows the yaw rate.
    found_a[:, 9] += found_a[:, 10] * found_b[10].sum() / found_b[9].sum()
    # A step of fourth order of a linear model.
    linear = bb.LinearModel(params)
    powers = [np.linalg.matrix_power(linear.A * dt, k) for k in range(5)]
    a = sum(power / np.prod(range(1, k + 1)) for k, power in enumerate(powers))
    b = dt * sum(power / np.prod(range(1, k + 2)) for k, power in enumerate(powers[:4])) @ linear.B
    np.testing.assert_allclose(found_a[:10, :10], a, atol=1e-12 * np.abs(a).max())
    np.testing.assert_allclose(found_b[:10], b, atol=1e-12 * np.abs(b).max())


def test_contact_with_grip_has_the_same_derivatives_to_the_order_of_its_step():
    params = bb.Params.paper()
    start = bb.State.rolling(params, (0.3, -0.1), quaternion(np.array([0.05, -0.02, 0.4])), (0.1, 0.2, 0.3), 0.2)
    errors = []
    for sim_dt in (2e-4, 1e-4):
        found = []
        for model in ("contact", "spatial"):
            robot = bb.Ballbot(params, model, sim_dt)
            robot.reset(start)
            found.append(np.hstack(robot.jacobian((0.02, -0.01, 0.03), round(0.02 / sim_dt)).rolling()))
        errors.append(np.abs(found[0] - found[1]).max() / np.abs(found[1]).max())
    assert errors[0] < 1e-3
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1)


def test_a_long_motion_has_the_product_of_the_derivatives_of_its_parts():
    robot = bb.Ballbot("kugle", "spatial")
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.05, 0.02)))
    torques = np.tile((0.2, -0.1, 0.1), (60, 1))
    whole, parts = robot.jacobian(torques[0], 60, ["body_mass"]), robot.jacobians(torques, 1, ["body_mass"])
    assert whole.states == parts.states
    assert len(whole.states) == 17
    assert not whole.one_sided
    state, by_torques, by_mass = np.zeros((60, 17)), np.zeros((60, 3)), 1.0
    state[-1, whole.states.index("ball_velocity_x")] = 1.0
    by_state, by_torques, by_mass = parts.vjp(state)
    row = whole.states.index("ball_velocity_x")
    np.testing.assert_allclose(by_state, whole.A[row], atol=1e-11)
    np.testing.assert_allclose(by_torques.sum(0), whole.B[row], atol=1e-11)
    np.testing.assert_allclose(by_mass, whole.P[row], atol=1e-11)
    robot.step(torques[0], 60)
    assert whole.state == robot.state


def test_a_batch_has_the_derivatives_of_single_robots():
    # Eight neighbors have the same robot.
    batch = bb.Batch(17, model="spatial", robot=["paper", "kugle", "rezero"])
    batch.reset()
    torques = np.full((17, 3), 0.1)
    found = batch.jacobians(torques, 5, ["body_mass"])
    assert found.valid.all()
    for i in (0, 8, 16):
        robot = bb.Ballbot(batch.params(i), "spatial", batch.sim_dt)
        robot.reset(batch.state(i))
        one = robot.jacobian(torques[i], 5, ["body_mass"])
        np.testing.assert_allclose(found.A[i], one.A, atol=1e-12)
        np.testing.assert_allclose(found.P[i], one.P, atol=1e-12)


def test_what_has_no_derivatives_is_said():
    slope = bb.Ballbot(model="spatial", terrain=bb.Terrain.plane(0.1))
    with pytest.raises(ValueError, match="'spatial' has no derivatives on a terrain"):
        slope.jacobian((0, 0, 0))
    planar = bb.Ballbot(model="planar")
    with pytest.raises(ValueError, match=r"with respect to body_com_offset\[0\].*symmetric about their mast"):
        planar.jacobian((0, 0, 0), 1, ["body_com_offset"])
    spatial = bb.Ballbot(model="spatial")
    with pytest.raises(ValueError, match="a whole number"):
        spatial.jacobian((0, 0, 0), 1, ["roller_count"])
    tilted = bb.Ballbot(bb.Params.paper().replace(floor_tilt=(0.05, 0.0)), "spatial")
    assert np.isfinite(tilted.jacobian((0, 0, 0), 10).A).all()
