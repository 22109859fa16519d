"""Derivatives of motions: against central differences, against each other, and where the motion has kinks."""

import contextlib
import os

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.envs.family import sample_robots

VECTORS = (
    "ball_position",
    "ball_quaternion",
    "body_position",
    "body_quaternion",
    "wheel_angles",
    "ball_velocity",
    "ball_angular_velocity",
    "body_velocity",
    "body_angular_velocity",
    "wheel_speeds",
)
POSITIONS, VELOCITIES, FORCES = KINDS = slice(0, 15), slice(15, 30), slice(30, 39)
#: Random robots.
CASES = int(os.environ.get("BALLBOT_CASES", "80"))
#: Largest error of a difference.
LIMIT = 1e-8
#: Steps of differences: of positions, wheel angles and velocities.
STEPS = np.array([1e-7] * 12 + [1e-4] * 3 + [1e-5] * 15)
TORQUES = np.array([0.11, -0.07, 0.05])


def product(a, b):
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def quaternion(rotation):
    angle = np.linalg.norm(rotation)
    return np.array([np.cos(angle / 2), *(np.sinc(angle / 2 / np.pi) / 2 * rotation)])


def moved(state, change):
    """A state changed along the coordinates of `Jacobian.states`."""
    values = {}
    for name, part in zip(VECTORS, np.reshape(change, (10, 3)), strict=True):
        value = np.array(getattr(state, name))
        if name == "ball_quaternion":
            value = product(quaternion(part), value)
        elif name == "body_quaternion":
            value = product(value, quaternion(part))
        else:
            value = value + part
        values[name] = value / np.linalg.norm(value) if "quaternion" in name else value
    return bb.State(**values)


def difference(after, before):
    """The change between two nearby states."""
    parts = []
    for name in VECTORS:
        a, b = np.array(getattr(after, name)), np.array(getattr(before, name))
        if "quaternion" not in name:
            parts.append(a - b)
            continue
        inverse = b * (1, -1, -1, -1)
        turn = product(a, inverse) if name == "ball_quaternion" else product(inverse, a)
        parts.append(2 * turn[1:] * np.sign(turn[0]))
    return np.concatenate(parts)


def central(function, step):
    """Derivative at 0, of fourth order."""
    near, far = ((function(h) - function(-h)) / (2 * h) for h in (step, 2 * step))
    return (4 * near - far) / 3


def forces(robot):
    contacts = robot.contacts
    return np.concatenate([contacts.wheel_normal_forces, contacts.wheel_tractions, contacts.floor_force])


class Case:
    """A robot in any state, with its derivatives and their differences."""

    def __init__(self, seed, steps=1):
        rng = np.random.default_rng(seed)
        self.steps = steps
        params = sample_robots(1, seed)[0]
        changes = [
            {"wheel_dynamic_friction": 0.2, "wheel_static_friction": 0.3, "floor_dynamic_friction": 0.2},
            {"roller_ripple": 2e-4, "roller_phases": (0.0, 1.0, 2.0), "roller_angle": -0.6},
            {"floor_rolling_friction": 1e-3, "roller_friction": 0.02, "roller_friction_slope": 0.1},
            {"body_products_of_inertia": np.array([0.02, -0.01, 0.01]) * min(params.body_inertia)},
            {"wheel_zenith_offsets": (0.01, -0.02, 0.0), "ball_viscous_friction": 2.0, "roller_angle": 0.4},
        ]
        for change in changes:
            # Not every body has these products of inertia.
            if rng.random() < 0.3:
                with contextlib.suppress(bb.InvalidInputError):
                    params = params.replace(**change)
        terrain = bb.Terrain.generate("hills", seed=seed) if rng.random() < 0.3 else None
        self.params, self.robot = params, bb.Ballbot(params, terrain=terrain)
        ball_gap, wheel_gap = 2e-5 * rng.normal(size=2)
        if rng.random() < 0.2:
            ball_gap = 0.05
        change = rng.normal(size=30) * 0.3
        change[[0, 1, 2, 6, 7, 8]] = [0, 0, ball_gap, 0, 0, ball_gap + wheel_gap]
        self.start = moved(self.robot.state, change)
        self.torques = rng.uniform(-0.9, 0.9, 3) * params.max_wheel_torque
        self.robot.reset(self.start)

    def after(self, change, torques=0.0):
        self.robot.reset(moved(self.start, change))
        self.robot.step(self.torques + torques, self.steps)
        return np.concatenate([difference(self.robot.state, self.end), forces(self.robot)])

    def worst(self, jacobian):
        """Largest error of a derivative, relative to the largest of its kind.

        Of the errors with several steps of a difference the smallest counts: rounding spoils small steps, and where
        wheels jam the ball, several solutions may be valid, and the robot jumps from one to another.
        """
        self.end = jacobian.state
        by_state = np.vstack([jacobian.A[:30, :30], jacobian.C[:, :30]])
        by_torques = np.vstack([jacobian.B[:30], jacobian.D])
        zero = np.zeros(30)
        columns = []
        for i, unit in enumerate(np.eye(30)):
            alike = by_state[:, :15] if i < 15 else by_state[:, 15:]
            columns.append((lambda h, unit=unit: self.after(h * unit), STEPS[i], by_state[:, i], alike))
        for i, unit in enumerate(np.eye(3)):
            columns.append((lambda h, unit=unit: self.after(zero, h * unit), 1e-3, by_torques[:, i], by_torques))
        worst = 0.0
        for function, step, exact, alike in columns:
            errors = []
            for factor in (1.0, 10.0, 0.1, 0.01):
                deviation = np.abs(central(function, factor * step) - exact)
                sizes = [max(np.abs(alike[rows]).max(), 1.0) for rows in KINDS]
                errors.append(max(deviation[rows].max() / size for rows, size in zip(KINDS, sizes, strict=True)))
                if errors[-1] < LIMIT:
                    break
            worst = max(worst, min(errors))
        return worst


class Forced(Case):
    """A robot under a force, whose moment turns with the body."""

    def after(self, change, torques=0.0):
        self.robot.reset(moved(self.start, change))
        self.force()
        self.robot.step(self.torques + torques, self.steps)
        return np.concatenate([difference(self.robot.state, self.end), forces(self.robot)])

    def force(self):
        weight = self.params.gravity * self.params.body_mass
        self.robot.apply_force((0.3 * weight, -0.2 * weight, 0.1 * weight), (0.1, 0.05, 0.4), frequency=30.0, phase=1.0)


def test_derivatives_under_a_force_equal_differences():
    worst = []
    for seed in range(0, CASES, 5):
        case = Forced(seed)
        case.force()
        jacobian = case.robot.jacobian(case.torques)
        if jacobian.margin > 0.06:
            worst.append(case.worst(jacobian))
    assert len(worst) > 4
    assert max(worst) < LIMIT


def test_derivatives_equal_differences_wherever_modes_stay():
    worst = []
    for seed in range(CASES):
        case = Case(seed)
        jacobian = case.robot.jacobian(case.torques)
        assert np.isfinite(jacobian.A).all()
        # A difference changes the modes of contacts that are close to others.
        if jacobian.margin > 0.06:
            worst.append(case.worst(jacobian))
    print(f"{len(worst)} robots, largest error {max(worst):.1e}, median of the robots' largest {np.median(worst):.1e}")
    assert len(worst) > 0.6 * CASES
    assert max(worst) < LIMIT


def test_a_long_motion_has_the_product_of_the_derivatives_of_its_parts():
    case = Case(2)
    parts = case.robot.jacobians(np.tile(case.torques, (100, 1)), 1, ["body_mass"])
    whole = case.robot.jacobian(case.torques, 100, ["body_mass"])
    n = len(whole.states)
    chained, by_torques, by_mass = np.eye(n), np.zeros((n, 3)), np.zeros((n, 1))
    for a, b, p in zip(parts.A, parts.B, parts.P, strict=True):
        chained, by_torques, by_mass = a @ chained, a @ by_torques + b, a @ by_mass + p
    np.testing.assert_allclose(whole.A, chained, rtol=1e-8, atol=1e-8 * np.abs(chained).max())
    np.testing.assert_allclose(whole.B, by_torques, rtol=1e-8, atol=1e-8 * np.abs(by_torques).max())
    np.testing.assert_allclose(whole.P, by_mass, rtol=1e-8, atol=1e-8 * np.abs(by_mass).max())
    case.robot.step(case.torques, 100)
    assert whole.state == case.robot.state
    assert whole.modes_changed


PARAMETERS = ("ball_mass", "ball_inertia", "body_mass", "wheel_inertia", "gravity", "ball_viscous_friction")


@pytest.mark.parametrize(
    "name", [*PARAMETERS, "body_inertia", "wheel_viscous_friction", "wheel_zenith", "wheel_preload"]
)
def test_derivatives_by_parameters_equal_differences(name):
    params = bb.Params.preset("kugle").replace(ball_viscous_friction=2.0, wheel_viscous_friction=0.01)
    if name == "wheel_preload":
        params = params.replace(wheel_preload=80.0)
    robot = bb.Ballbot(params)
    # Above the floor by less than it falls in a step, so that no difference changes a mode.
    change = np.zeros(30)
    change[[2, 8]] = 2e-6, 3e-6
    change[[9, 10, 17, 18, 25]] = 0.02, -0.03, -1e-3, 0.1, 0.2
    start = moved(robot.state, change)
    robot.reset(start)
    jacobian = robot.jacobian(TORQUES, 1, [name])
    value = np.array(getattr(params, name), float)
    assert len(jacobian.parameters) == value.size

    def after(changed, element):
        shifted = value.copy()
        shifted[element] += changed
        other = bb.Ballbot(params.replace(**{name: shifted if value.ndim else float(shifted)}))
        other.reset(start)
        other.step(TORQUES)
        return np.concatenate([difference(other.state, jacobian.state), forces(other)])

    exact = np.vstack([jacobian.P, jacobian.Q])
    for column, element in enumerate(np.ndindex(value.shape)):
        found = central(lambda h, e=element: after(h, e), 1e-4 * value[element])
        for rows in (POSITIONS, VELOCITIES, FORCES):
            scale = np.abs(exact[rows, column]).max()
            assert np.abs(found[rows] - exact[rows, column]).max() <= 1e-6 * scale + 1e-9


@pytest.mark.parametrize("preload", [0.0, 20.0])
def test_a_preload_has_derivatives_where_wheels_slip(preload):
    def after(change):
        robot = bb.Ballbot(bb.Params.paper().replace(wheel_preload=preload + change))
        robot.reset(bb.State.at_rest(robot.params, (0.03, -0.02)))
        robot.step(np.array([2.0, 1.9, 2.1]), 2)
        return robot

    robot = bb.Ballbot(bb.Params.paper().replace(wheel_preload=preload))
    robot.reset(bb.State.at_rest(robot.params, (0.03, -0.02)))
    jacobian = robot.jacobian(np.array([2.0, 1.9, 2.1]), 2, ["wheel_preload"])
    assert np.abs(after(0.0).contacts.wheel_slip_speeds).min() > 0.1

    def change(step):
        robot = after(step)
        return np.concatenate([difference(robot.state, jacobian.state), forces(robot)])

    # Of second order, and ahead, since a preload is not negative.
    found = (4 * change(1e-3) - change(2e-3) - 3 * change(0.0)) / 2e-3
    exact = np.concatenate([jacobian.P[:30, 0], jacobian.Q[:, 0]])
    for rows in KINDS:
        assert np.abs(found[rows] - exact[rows]).max() <= 1e-5 * np.abs(exact[rows]).max() + 1e-10
        assert np.abs(exact[rows]).max() > 1e-6


@pytest.mark.parametrize(
    "name",
    [
        "wheel_coulomb_friction",
        "floor_rolling_friction",
        "floor_spinning_friction",
        "roller_friction",
        "wheel_preload",
    ],
)
def test_a_friction_of_zero_has_the_derivatives_of_a_small_one(name):
    params = bb.Params.paper()
    robot = bb.Ballbot(params)
    change = np.zeros(30)
    change[[2, 8]] = 2e-6, 3e-6
    change[[9, 10, 15, 18, 19, 20, 25]] = 0.02, -0.03, 0.1, 0.1, -0.2, 0.3, 0.2
    start = moved(robot.state, change)
    robot.reset(start)
    jacobian = robot.jacobian((0.3, -0.2, 0.1), 1, [name])

    def after(friction):
        other = bb.Ballbot(params.replace(**{name: friction}))
        other.reset(start)
        other.step((0.3, -0.2, 0.1))
        return np.concatenate([difference(other.state, jacobian.state), forces(other)])

    step = 1e-6
    found = (4 * after(step) - after(2 * step) - 3 * after(0.0)) / (2 * step)
    exact = np.concatenate([jacobian.P[:30, 0], jacobian.Q[:, 0]])
    assert exact.any()
    for rows in KINDS:
        assert np.abs(found[rows] - exact[rows]).max() <= 1e-4 * np.abs(exact[rows]).max() + 1e-7


def test_forward_and_reverse_products_agree():
    rng = np.random.default_rng(0)
    robot = bb.Ballbot("rezero")
    robot.push((0.5, 0.2, 0.0))
    motion = robot.jacobians(rng.uniform(-0.3, 0.3, (200, 3)), 2, ["body_mass", "body_com_offset"])
    assert len(motion) == 200
    assert motion.parameters == ("body_mass", "body_com_offset[0]", "body_com_offset[1]")
    for _ in range(20):
        state, torques, parameters = rng.normal(size=30), rng.normal(size=(200, 3)), rng.normal(size=3)
        forward = motion.jvp(state, torques, parameters)
        weights = rng.normal(size=forward.shape) / np.abs(forward).max()
        by_state, by_torques, by_parameters = motion.vjp(weights)
        reverse = by_state @ state + (by_torques * torques).sum() + by_parameters @ parameters
        size = (np.abs(weights) * np.abs(forward)).sum()
        assert (weights * forward).sum() == pytest.approx(reverse, abs=1e-10 * size)
    np.testing.assert_array_equal(motion.jvp(), np.zeros((200, 30)))


def test_robots_of_a_batch_have_the_derivatives_of_single_robots():
    lossy = bb.Params.paper().replace(floor_rolling_friction=1e-3, floor_spinning_friction=1e-3)
    robots = [*sample_robots(3, 3), lossy]
    batch = bb.Batch(32, robot=robots, num_threads=2)
    batch.reset()
    batch.step(np.zeros((32, 3), np.float32))
    torques = np.tile(TORQUES, (32, 1))
    all_of_them = batch.jacobians(torques, 5, ["body_mass"])
    # One robot has losses, so all have the loads as states.
    assert all_of_them.A.shape == (32, 36, 36)
    loads = [f"floor_force_{axis}" for axis in "xyz"] + [f"wheel_normal_force_{i}" for i in range(3)]
    assert all_of_them.states[30:] == tuple(loads)
    assert all_of_them.valid.all()
    assert not all_of_them.A[:24, :30, 30:].any()
    assert all_of_them.A[24:, :30, 30:].any()
    for i in range(24):
        robot = bb.Ballbot(batch.params(i), sim_dt=batch.sim_dt)
        robot.reset(batch.state(i))
        one = robot.jacobian(TORQUES, 5, ["body_mass"])
        np.testing.assert_allclose(all_of_them.A[i, :30, :30], one.A, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(all_of_them.P[i, :30], one.P, rtol=1e-8, atol=1e-11)


def test_a_batch_has_columns_for_each_of_several_torques():
    # Eight neighbors have the same robot.
    batch = bb.Batch(17, robot=["paper", "kugle", "rezero"])
    batch.reset()
    torques = np.random.default_rng(0).uniform(-0.05, 0.05, (17, 4, 3))
    found = batch.jacobians(torques, 2, ["body_mass"])
    assert found.B.shape == (17, 30, 12)
    assert found.D.shape == (17, 9, 12)
    for i in (0, 8, 16):
        robot = bb.Ballbot(batch.params(i), sim_dt=batch.sim_dt)
        robot.reset(batch.state(i))
        parts = robot.jacobians(torques[i], 2, ["body_mass"])
        for row in range(30):
            weights = np.zeros((4, 30))
            weights[-1, row] = 1.0
            by_state, by_torques, by_mass = parts.vjp(weights)
            np.testing.assert_allclose(found.A[i, row], by_state, rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(found.B[i, row], by_torques.ravel(), rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(found.P[i, row], by_mass, rtol=1e-8, atol=1e-9)
    for wrong in (np.zeros((17, 0, 3)), np.zeros((2, 4, 3)), np.zeros((17, 4, 2)), np.zeros(3)):
        with pytest.raises(ValueError, match="wheel_torques"):
            batch.jacobians(wrong)
    torques[1, 2, 0] = 99.0
    with pytest.raises(ValueError, match=r"wheel_torques\[1, 2, 0\] = 99"):
        batch.jacobians(torques)


def test_a_robot_that_falls_has_no_derivatives_and_leaves_its_neighbors_theirs():
    batch = bb.Batch(9)
    params = bb.Params.paper()
    starts = [bb.State.at_rest(params, tilt=(0.3, 0.0)) if i == 4 else bb.State.at_rest(params) for i in range(9)]
    batch.reset(starts=starts)
    jacobians = batch.jacobians(np.zeros((9, 3)), 2000)
    np.testing.assert_array_equal(jacobians.valid, np.arange(9) != 4)
    assert np.isfinite(jacobians.A).all()
    assert not jacobians.A[4].any()
    robot = bb.Ballbot()
    robot.reset(starts[4])
    with pytest.raises(ValueError, match="the bot touches the floor"):
        robot.jacobian((0, 0, 0), 2000)


def test_shapes_do_not_depend_on_what_is_valid():
    batch = bb.Batch(2)
    batch.reset(starts=[bb.State.at_rest(bb.Params.paper(), tilt=(0.3, 0.0))] * 2)
    jacobians = batch.jacobians(np.zeros((2, 3)), 2000, ["body_mass"])
    assert not jacobians.valid.any()
    assert jacobians.A.shape == (2, 30, 30)
    assert jacobians.P.shape == (2, 30, 1)
    motion = bb.Ballbot().jacobians(np.zeros((0, 3)))
    assert motion.A.shape == (0, 30, 30)
    assert motion.vjp(np.zeros((0, 30)))[1].shape == (0, 3)


def test_torques_and_parameters_of_every_robot_of_a_batch_are_checked():
    batch = bb.Batch(16, robot=["kugle", "paper"])
    batch.reset()
    torques = np.zeros((16, 3))
    with pytest.raises(ValueError, match="two principal moments"):
        batch.jacobians(torques, 1, ["body_products_of_inertia"])
    torques[12, 1] = 50.0
    with pytest.raises(ValueError, match=r"wheel_torques\[12, 1\] = 50"):
        batch.jacobians(torques)
    with pytest.raises(ValueError, match="solved by iteration"):
        bb.Batch(2, model="rigid").jacobians(np.zeros((2, 3)))


def test_rolling_coordinates_are_the_linear_model_of_a_robot_at_rest():
    for preset in ("paper", "rezero"):
        params = bb.Params.preset(preset)
        a, b = bb.Ballbot(params, sim_dt=1e-4).jacobian((0, 0, 0), 100).rolling()
        exact_a, exact_b = bb.LinearModel(params).discretize(0.01)
        np.testing.assert_allclose(a[:10, :10], exact_a, atol=3e-5 * np.abs(exact_a).max())
        np.testing.assert_allclose(b[:10], exact_b, atol=1e-4 * np.abs(exact_b).max())
    hills = bb.Ballbot(terrain=bb.Terrain.generate("hills", seed=0))
    with pytest.raises(ValueError, match="not of a terrain"):
        hills.jacobian((0, 0, 0)).rolling()


def test_kinks_are_reported():
    robot = bb.Ballbot()
    at_rest = robot.jacobian((0, 0, 0))
    assert at_rest.margin == 0.0
    assert at_rest.one_sided
    change = np.zeros(30)
    change[[2, 8]] = 0.003, 0.004
    robot.reset(moved(robot.state, change))
    flight, landing = robot.jacobian((0, 0, 0)), robot.jacobian((0, 0, 0), 60)
    assert not flight.one_sided
    assert not flight.modes_changed
    assert landing.modes_changed
    assert np.isfinite(landing.A).all()
    assert "modes change" in repr(landing)


def test_grip_does_not_depend_on_friction_and_slip_does():
    change = np.zeros(30)
    change[[2, 8]] = 2e-6, 3e-6
    for torques, slips in (((0.1, 0.1, 0.1), False), ((4.0, 4.0, 4.0), True)):
        robot = bb.Ballbot(bb.Params.paper().replace(wheel_static_friction=0.5, wheel_dynamic_friction=0.5))
        robot.reset(moved(robot.state, change))
        jacobian = robot.jacobian(torques, 1, ["wheel_dynamic_friction", "max_wheel_torque"])
        assert bool(jacobian.P[:, 0].any()) == slips
        assert not jacobian.P[:, 1].any()


@pytest.mark.parametrize(
    ("model", "arguments", "error"),
    [
        ("contact", ((0, 0, 0), 0), "steps = 0, it must be at least 1"),
        ("contact", ((0, 0, 0), 1, ["body_weight"]), "unknown parameter 'body_weight'"),
        ("contact", ((0, 0, 0), 1, ["body_inertia[3]"]), r"unknown parameter 'body_inertia\[3\]'"),
        ("contact", ((0, 0, 0), 1, ["body_com_offset[00]"]), r"unknown parameter 'body_com_offset\[00\]'"),
        ("contact", ((0, 0, 0), 1, "body_mass"), "a list of names, not one name"),
        ("contact", ((0, 0, 0), 1, ["roller_count"]), "a whole number"),
        ("contact", ((0, 0, 0), 1, ["roller_ripple"]), "roller_ripple = 0"),
        ("contact", ((0, 0, np.nan),), r"wheel_torques\[2\]"),
        ("contact", ((0, 0, 99),), "max_wheel_torque"),
        ("rigid", ((0, 0, 0),), "solved by iteration"),
    ],
)
def test_bad_input(model, arguments, error):
    with pytest.raises((ValueError, TypeError), match=error):
        bb.Ballbot(model=model).jacobian(*arguments)


def test_principal_axes_of_equal_moments_have_no_derivative():
    robot = bb.Ballbot(bb.Params.paper().replace(body_inertia=(0.05, 0.05, 0.02)))
    with pytest.raises(ValueError, match="two principal moments"):
        robot.jacobian((0, 0, 0), 1, ["body_products_of_inertia"])
    # Products that do not mix the equal moments turn nothing but the third axis.
    assert np.isfinite(robot.jacobian((0, 0, 0), 1, ["body_products_of_inertia[1]"]).P).all()
    assert np.isfinite(robot.jacobian((0, 0, 0), 1, ["body_inertia"]).P).all()
