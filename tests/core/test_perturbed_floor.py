"""A floor that moves, and on which friction differs from place to place: laws, sensors, options and MuJoCo."""

import copy

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import _state_rows as rows

SHIP = {"floor_tilt_amplitude": (0.05, 0.03), "floor_tilt_period": 6.0, "floor_tilt_phases": (0.4, 1.7)}
TRAM = {"floor_acceleration": (0.4, -0.2), "floor_acceleration_period": 3.0, "floor_acceleration_rise": 0.3}


def rotation(quaternion):
    """Rotation matrix of (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_the_default_floor_is_at_rest_and_even(paper):
    assert not paper.has_perturbed_floor
    assert paper.gravity_at(3.0) == paper.gravity_vector
    assert paper.floor_rate_at(3.0) == (0.0, 0.0, 0.0)
    assert paper.floor_friction_factor(1.0, -2.0) == 1.0
    robot = paper.replace(**SHIP, **TRAM, floor_friction_gradient=(0.1, 0.0), floor_patch_size=0.2)
    assert robot.has_perturbed_floor
    assert robot.on_still_floor().gravity_at(1.0) == paper.gravity_vector


def test_gravity_turns_with_the_floor_and_is_less_its_acceleration(paper):
    ship = paper.replace(**SHIP)
    for time in (0.0, 1.3, 7.7):
        angle = 2.0 * np.pi * time / 6.0 + np.array([0.4, 1.7])
        tilt = np.array([0.05, 0.03]) * np.sin(angle)
        expected = np.array(paper.replace(floor_tilt=tuple(tilt)).gravity_vector)
        np.testing.assert_allclose(ship.gravity_at(time), expected, atol=1e-10)
        both = ship.replace(floor_acceleration=(0.5, 0.2), floor_acceleration_period=2.0)
        change = np.array([0.5, 0.2, 0.0]) * np.sin(np.pi * time)
        np.testing.assert_allclose(both.gravity_at(time), expected - change, atol=1e-10)
        # The floor turns: a vector at rest outside, such as gravity, turns against it.
        rate = np.array(ship.floor_rate_at(time))
        change = (np.array(ship.gravity_at(time + 1e-4)) - np.array(ship.gravity_at(time - 1e-4))) / 2e-4
        np.testing.assert_allclose(change, -np.cross(rate, ship.gravity_at(time)), atol=1e-6)


@pytest.mark.parametrize("model", ["spatial", "contact", "rigid"])
@pytest.mark.parametrize("period", [6.0, 2.0, 0.8])
def test_lqr_follows_an_accelerating_floor_with_the_gain_and_phase_of_the_linear_model(paper, model, period):
    amplitude, control_dt = 0.02, 0.01
    robot = paper.replace(floor_acceleration=(amplitude, 0.0), floor_acceleration_period=period)
    law, linear = bb.Lqr(paper, control_dt), bb.LinearModel(paper)
    names = list(linear.STATES)
    a, (step, drive) = np.asarray(linear.A), map(np.asarray, linear.discretize(control_dt))
    # Acceleration of the states per acceleration of the floor: of a floor with a small slope, per slope and gravity.
    slope = 1e-6
    upright = (1.0, 0.0, 0.0, 0.0)
    sloped = bb.SpatialModel(paper.replace(floor_tilt=(0.0, -slope)))
    rates = np.asarray(sloped.accelerations(upright, np.zeros(6), np.zeros(3))) / (slope * paper.gravity)
    disturbance = np.zeros(10)
    disturbance[[5, 6, 7, 8, 9]] = rates[:5]
    # Over a control step with held torques.
    rate = 2.0 * np.pi / period
    turn = np.exp(1j * rate * control_dt)
    integral = np.linalg.solve(1j * rate * np.eye(10) - a, (turn * np.eye(10) - step) @ disturbance)
    closed = turn * np.eye(10) - (step - drive @ np.asarray(law.gain))
    expected = amplitude * np.linalg.solve(closed, integral)

    moving = bb.Ballbot(robot, model, 0.001)
    moving.reset(bb.State.at_equilibrium(robot))
    found, times = [], []
    settling, counted = 12.0, 3
    for k in range(round((settling + counted * period) / control_dt)):
        if k * control_dt >= settling:
            state = moving.state
            found.append([state.ball_position[0], state.tilt_components[1]])
            times.append(k * control_dt)
        moving.step(law(moving.state), 10)
    waves = np.stack([np.sin(rate * np.array(times)), np.cos(rate * np.array(times)), np.ones(len(times))], axis=1)
    fitted = np.linalg.lstsq(waves, np.array(found), rcond=None)[0]
    # Im of X exp(i ω t), as the acceleration is A sin ω t.
    measured = fitted[0] + 1j * fitted[1]
    for value, name in zip(measured, (names[0], names[3]), strict=True):
        ours = expected[names.index(name)]
        assert abs(value - ours) < 0.02 * abs(ours), f"{name}: {value} against {ours}"


def test_an_accelerometer_feels_gravity_less_the_acceleration_and_a_gyroscope_the_turning_floor(paper):
    place = np.array([0.01, 0.02, 0.2])
    robots = [paper, paper.replace(**TRAM), paper.replace(**SHIP, **TRAM), paper.replace(**SHIP)]
    for robot in robots:
        for model in ("contact", "rigid", "spatial"):
            batch = bb.Batch(2, "balance", robot=robot, model=model, sensors={"imu_position": place})
            batch.reset()
            state = batch.state(0)
            for k in range(30):
                body = rotation(state.body_quaternion)
                before = np.array(state.body_velocity) + body @ np.cross(state.body_angular_velocity, place)
                halfway = np.array(state.body_quaternion)
                batch.step(np.full((2, 3), 0.2))
                state = batch.state(0)
                body = rotation(state.body_quaternion)
                after = np.array(state.body_velocity) + body @ np.cross(state.body_angular_velocity, place)
                gravity = np.mean([robot.gravity_at(0.01 * k + (i + 0.5) * 0.002) for i in range(5)], axis=0)
                halfway = halfway + np.array(state.body_quaternion)
                felt = rotation(halfway / np.linalg.norm(halfway)).T @ ((after - before) / 0.01 - gravity)
                readings = batch.readings(0)
                np.testing.assert_allclose(readings["specific_force"], felt, atol=1e-9)
                rate = np.array(state.body_angular_velocity) + body.T @ robot.floor_rate_at(0.01 * (k + 1))
                np.testing.assert_allclose(readings["gyro"], rate, atol=1e-12)


# An acceleration of the floor looks to the estimator like wheels that slip: docs/terrain.md.
@pytest.mark.parametrize("floor", [SHIP, {**TRAM, "floor_acceleration": (0.1, -0.05)}])
def test_robots_balance_on_what_their_sensors_measure(paper, floor):
    robot = paper.replace(**floor)
    batch = bb.Batch(
        8, "balance", robot=robot, sensors={}, observation="sensors", reset_tilt=0.02, max_wheel_torque=3.0
    )
    batch.reset()
    record = batch.rollout(bb.Controller("lqr", robot, 0.01), 900, record=["terminated"])
    assert not record["terminated"].any()


def test_events_give_each_robot_its_own_floor():
    events = [
        {"term": "floor_tilt_amplitude", "range": [0.0, 0.05]},
        {"term": "floor_tilt_period", "range": [5.0, 12.0]},
        {"term": "floor_tilt_phases", "range": [0.0, 6.0]},
        {"term": "floor_patch_size", "range": [0.2, 0.5]},
        {"term": "floor_patch_friction", "range": [[0.2, 0.4], [0.5, 1.0]]},
        {"term": "floor_patch_seed", "range": [0.0, 1e6]},
    ]
    batch = bb.Batch(16, events=events, sensors={})
    batch.reset()
    assert len({batch.params(i).floor_tilt_amplitude for i in range(16)}) == 16
    assert all(0.2 <= batch.params(i).floor_friction_factor(1.0, 1.0) <= 1.0 for i in range(16))
    batch.step(np.zeros((16, 3)))
    # On a terrain, too.
    hills = bb.Batch(2, "balance", events=events, terrain={"kind": "noise", "slope": 0.05})
    hills.reset()
    hills.step(np.zeros((2, 3)))


def test_what_a_model_or_a_stage_cannot_do_is_rejected_by_name(paper):
    with pytest.raises(ValueError, match="no slip, so it changes nothing"):
        bb.Batch(1, model="spatial", events=[{"term": "floor_patch_friction", "range": [0.5, 1.0]}])
    optional = [{"term": "floor_patch_size", "range": [0.5, 1.0], "optional": True}]
    optional.append({"term": "floor_patch_friction", "range": [0.5, 1.0], "optional": True})
    bb.Batch(1, model="spatial", events=optional).reset()
    with pytest.raises(ValueError, match=r"roll without slip.*floor_friction_gradient = \[0.1, 0.0\]"):
        bb.Ballbot(paper.replace(floor_friction_gradient=(0.1, 0.0)), "spatial")
    with pytest.raises(ValueError, match="the models neglect this acceleration"):
        paper.replace(floor_tilt_amplitude=(0.2, 0.0), floor_tilt_period=1.0)
    with pytest.raises(ValueError, match=r"derivatives of motions: floor_acceleration = \[0.4, -0.2\]"):
        bb.Ballbot(paper.replace(**TRAM)).jacobian(np.zeros(3))
    with pytest.raises(ValueError, match="derivatives with respect to floor_tilt_period are not computed"):
        bb.Ballbot(paper).jacobian(np.zeros(3), 1, ["floor_tilt_period"])
    batch = bb.Batch(1, sensors={})
    with pytest.raises(ValueError, match="the sensors were made for floors that do not turn"):
        batch.set_params(0, paper.replace(**SHIP))
    batch.set_params(0, paper.replace(**TRAM))


def test_planners_plan_on_a_floor_at_rest(paper):
    robot = paper.replace(**TRAM, floor_patch_size=0.5, floor_patch_friction=(0.5, 1.0))
    state = bb.State.at_rest(paper, (0.02, -0.01))
    for name in ("nmpc", "mppi"):
        ours, theirs = (bb.Controller(name, one, 0.01)(state) for one in (robot, paper))
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "floor",
    [
        SHIP,
        TRAM,
        {**SHIP, **TRAM},
        {"floor_friction_gradient": (3.0, -2.0)},
        {"floor_patch_size": 0.05, "floor_patch_friction": (0.2, 1.8), "floor_patch_seed": 3},
    ],
)
def test_mujoco_agrees(paper, floor):
    pytest.importorskip("mujoco")
    from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
    from ballbot_rs.engines.robot_geometry import robot_geometry

    def moved(robot):
        theirs = MujocoRobot(robot_geometry(robot), accurate(2e-4))
        ours = bb.Ballbot(robot, "contact", 2e-4)
        start = bb.State.at_equilibrium(robot)
        # All of it slides on the floor.
        row = start.to_array()
        row[rows.BALL_VELOCITY] = row[rows.BODY_VELOCITY] = (speed, 0.0, 0.0)
        start = bb.State.from_array(row)
        theirs.reset(start)
        ours.reset(start)
        theirs.step(np.zeros(3), 1500)
        ours.step(np.zeros(3), 1500)
        return np.array([theirs.state().ball_position[:2], ours.state.ball_position[:2]])

    # Where friction differs, slower ground for longer slides.
    friction, speed = (0.2, 0.5) if "floor_tilt_amplitude" in floor or "floor_acceleration" in floor else (0.05, 1.0)
    robot = paper.replace(floor_static_friction=friction, floor_dynamic_friction=friction, wheel_static_friction=1.0)
    even = moved(robot)
    found, ours = moved(robot.replace(**floor))
    change = np.linalg.norm(ours - even[1])
    assert change > 2e-3
    assert np.linalg.norm(found - ours) < 0.02 * change


def test_the_mujoco_engine_has_patches_and_rejects_motion(paper):
    pytest.importorskip("mujoco")
    from ballbot_rs.engines.engine_batch import in_engine

    patches = paper.replace(floor_patch_size=0.1, floor_patch_friction=(0.3, 1.0))
    batch = in_engine(bb.Batch(1, robot=patches), "mujoco")
    batch.reset()
    batch.step(np.zeros((1, 3)))
    with pytest.raises(bb.InvalidInputError, match="floor_acceleration"):
        in_engine(bb.Batch(1, robot=paper.replace(**TRAM)), "mujoco")


def test_copies_have_the_contact_forces_of_the_last_step():
    robot = bb.Params.paper().replace(floor_acceleration=(2.0, 0.0), floor_acceleration_period=0.5)
    for model in ("spatial", "contact", "rigid"):
        one = bb.Ballbot(robot, model=model)
        one.step(np.zeros(3), 10)
        other = copy.copy(one)
        assert other.state == one.state
        np.testing.assert_array_equal(other.contacts.floor_force, one.contacts.floor_force, err_msg=model)


@pytest.mark.parametrize("name", ["floor_tilt_period", "floor_acceleration_period"])
def test_periods_that_time_steps_would_not_sample_are_rejected(paper, name):
    with pytest.raises(ValueError, match=rf"{name} = 0.05 is out of range"):
        paper.replace(**{name: 0.05})


@pytest.mark.parametrize(
    "floor",
    [SHIP, TRAM, {"floor_friction_gradient": (0.1, 0.0)}, {"floor_patch_size": 0.1, "floor_patch_friction": (0.5, 1)}],
)
def test_what_needs_a_still_floor_names_what_moves(paper, floor):
    name = next(iter(floor))
    with pytest.raises(ValueError, match=f"an optimization: {name} = .* must be 0"):
        bb.optimize_trajectory(goal=(0.5, 0.0), seconds=2.0, robot=paper.replace(**floor))
