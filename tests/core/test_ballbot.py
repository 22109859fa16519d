"""`Ballbot` on all three models: what it does, what it remembers, and how it fails."""

import copy
import pickle

import numpy as np
import pytest

from ballbot_rs import Ballbot, Batch, DivergedError, Lqr, Params, State

MODELS = ["rigid", "contact", "spatial", "planar"]
TORQUES = (0.05, -0.02, 0.01)


@pytest.mark.parametrize("model", MODELS)
def test_a_new_robot_is_upright_at_rest(model, paper):
    robot = Ballbot(model=model)
    assert robot.model == model
    assert robot.sim_dt == 0.001
    assert robot.time == 0.0
    assert robot.params == paper
    np.testing.assert_allclose(robot.state.to_array(), State.at_rest(paper).to_array(), atol=1e-12)
    assert robot.energy == pytest.approx(paper.body_mass * paper.gravity * paper.body_com_height, rel=1e-9)
    assert f"model='{model}'" in repr(robot)


@pytest.mark.parametrize("model", MODELS)
def test_time_counts_the_steps(model):
    robot = Ballbot(model=model, sim_dt=0.002)
    robot.step((0, 0, 0))
    robot.step((0, 0, 0), steps=49)
    assert robot.time == pytest.approx(0.1, abs=1e-12)
    robot.step((0, 0, 0), steps=0)
    assert robot.time == pytest.approx(0.1, abs=1e-12)
    robot.reset()
    assert robot.time == 0.0


@pytest.mark.parametrize("model", MODELS)
def test_many_steps_at_once_equal_single_steps(model):
    one, many = Ballbot(model=model), Ballbot(model=model)
    for _ in range(50):
        one.step(TORQUES)
    many.step(TORQUES, 50)
    assert one.state == many.state
    assert one.time == many.time
    assert one.state != Ballbot(model=model).state


@pytest.mark.parametrize("model", MODELS)
def test_a_reset_robot_equals_a_new_one(model):
    used, new = Ballbot(model=model), Ballbot(model=model)
    used.step(TORQUES, 100)
    used.push((0.1, 0.0, 0.0))
    for robot in (used, new):
        robot.reset(State.at_rest(robot.params, tilt=(0.02, 0.01), yaw=0.4))
        robot.step(TORQUES, 100)
    assert used.state == new.state
    assert used.energy == new.energy


@pytest.mark.parametrize("model", MODELS)
def test_reset_to_a_state(model, paper):
    robot = Ballbot(model=model)
    state = State.rolling(paper, (0.3, -0.1))
    robot.reset(state)
    np.testing.assert_allclose(robot.state.to_array(), state.to_array(), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_static_loads(model):
    robot = Ballbot(model=model)
    regulator = Lqr(control_dt=0.001)
    for _ in range(1500):
        robot.step(regulator(robot.state))
    contacts = robot.contacts
    np.testing.assert_allclose(contacts.wheel_normal_forces, 10.303, rtol=1e-3)
    np.testing.assert_allclose(contacts.floor_force, [0.0, 0.0, 35.95], rtol=1e-3, atol=0.02)
    np.testing.assert_allclose(contacts.wheel_slip_speeds, 0.0, atol=1e-3)
    np.testing.assert_allclose(contacts.floor_slip_velocity, 0.0, atol=1e-3)
    assert contacts.floor_slip_velocity.shape == (2,)
    assert contacts.bot_on_floor is False
    assert contacts.friction_utilization.shape == (4,)
    assert contacts.friction_utilization.max() < 0.01
    assert repr(contacts).startswith("<Contacts: loads (10.3, 10.3, 10.3) N, slip (")
    assert repr(contacts).endswith(" m/s, floor 35.95 N>")


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_every_step_that_needed_a_search_is_counted(model, paper):
    slippery = paper.replace(
        wheel_static_friction=1.0, wheel_dynamic_friction=1.0, floor_static_friction=1.0, floor_dynamic_friction=1.0
    )
    options = {"robot": slippery, "model": model, "max_wheel_torque": 1.0}
    batch = Batch(64 if model == "contact" else 8, **options)
    batch.reset()
    rng = np.random.default_rng(0)
    searched = 0
    for _ in range(200):
        batch.step(rng.uniform(-1, 1, (batch.num_envs, 3)))
        contacts = batch.contacts()
        searched = max(searched, contacts["searched_steps"].max())
        assert (contacts["unsolved_steps"] <= contacts["searched_steps"]).all()
    assert searched > 0
    most = int(contacts["searched_steps"].argmax())
    assert batch.contacts(most).searched_steps == contacts["searched_steps"][most]
    batch.reset()
    assert not batch.contacts()["searched_steps"].any()


@pytest.mark.parametrize("model", MODELS)
def test_energy_is_conserved_without_friction(model):
    robot = Ballbot(model=model, sim_dt=0.0005)
    robot.reset(State.at_rest(robot.params, tilt=(0.05, 0.02)))
    before = robot.energy
    robot.step((0, 0, 0), 600)
    assert robot.state.tilt > 0.1
    assert robot.energy == pytest.approx(before, rel=2e-3)


def rate_after_a_push(model, point=None):
    robot = Ballbot(model=model)
    # The rigid model's contacts settle first.
    robot.step((0, 0, 0), 100)
    robot.push((0.02, 0.0, 0.0), point)
    robot.step((0, 0, 0), 10)
    return robot.state.body_angular_velocity


@pytest.mark.parametrize("model", MODELS)
def test_a_push_along_x_tilts_about_y(model, paper):
    rate = rate_after_a_push(model)
    assert rate[1] == pytest.approx(0.02 * 0.9014, rel=0.01)
    np.testing.assert_allclose(rate[[0, 2]], 0.0, atol=1e-4)
    com = (0.0, 0.0, paper.body_com_height)
    np.testing.assert_array_equal(rate_after_a_push(model, com), rate)
    assert rate_after_a_push(model, (0.0, 0.0, 0.3))[1] > 1.5 * rate[1]


@pytest.mark.parametrize("model", MODELS)
def test_joint_friction_dissipates_and_outlives_a_reset(model):
    free, damped = Ballbot(model=model), Ballbot(model=model)
    rough = damped.params.replace(wheel_viscous_friction=0.01, wheel_coulomb_friction=0.002)
    damped.set_params(rough)
    for robot in (free, damped):
        robot.reset(State.at_rest(robot.params, tilt=(0.05, 0.0)))
        robot.step((0, 0, 0), 300)
    assert damped.energy < free.energy - 1e-3
    assert damped.params == rough
    assert free.params == Params.paper()


@pytest.mark.parametrize(
    "loss", ["floor_rolling_friction", "floor_spinning_friction", "roller_friction", "roller_friction_slope"]
)
def test_losses_at_the_ball_dissipate_and_planar_rejects_them(loss):
    rough = Params.paper().replace(**{loss: 0.003})
    assert getattr(rough, loss) == 0.003
    with pytest.raises(ValueError, match=f"{loss} = 0.003, but it requires 0"):
        Ballbot(rough, model="planar")
    for model in ("spatial", "contact", "rigid"):
        free, lossy = Ballbot(model=model), Ballbot(rough, model=model)
        for robot in (free, lossy):
            robot.reset(State.rolling(robot.params, (0.3, 0.2), ball_spin=1.0))
            robot.step((0, 0, 0), 50)
        assert lossy.energy < free.energy - 1e-5, model


def test_roller_ripple_moves_the_body_vertically_and_models_without_slip_reject_it(paper):
    rippled = paper.replace(roller_ripple=1e-4, roller_count=10, roller_phases=(0.1, 0.2, -0.3))
    assert (rippled.roller_ripple, rippled.roller_count, rippled.roller_phases) == (1e-4, 10.0, (0.1, 0.2, -0.3))
    for model in ("planar", "spatial"):
        with pytest.raises(ValueError, match=r"'planar' and 'spatial' roll on round wheels.* roller_ripple = 0.0001 m"):
            Ballbot(rippled, model=model)
    for model in ("contact", "rigid"):
        robot = Ballbot(rippled, model=model)
        robot.reset(State.rolling(rippled, (0.5, 0.0)))
        heights = []
        for _ in range(100):
            robot.step((0, 0, 0), 1)
            heights.append(robot.state.body_position[2])
        assert 5e-5 < np.ptp(heights) < 1.5e-4, model


def test_a_robot_balances_on_a_tilted_floor_and_planar_rejects_it(paper):
    tilted = paper.replace(floor_tilt=(0.03, -0.04))
    assert tilted.floor_tilt == (0.03, -0.04)
    assert paper.gravity_vector == (0.0, 0.0, -9.81)
    assert paper.slope_lean() == (0.0, 0.0)
    assert paper.holding_torques() == (0.0, 0.0, 0.0)
    share = 9.81 * np.sin(0.05) / 0.05
    np.testing.assert_allclose(tilted.gravity_vector, [-0.04 * share, -0.03 * share, -9.81 * np.cos(0.05)], rtol=1e-14)
    start = State.at_equilibrium(tilted, tilted.slope_lean(), yaw=0.4)
    for model in ("spatial", "contact", "rigid"):
        robot = Ballbot(tilted, model)
        robot.reset(start)
        robot.step(tilted.holding_torques(0.4), 50)
        np.testing.assert_allclose(robot.state.to_array(), start.to_array(), atol=1e-8, err_msg=model)
        weight = -(paper.ball_mass + paper.body_mass) * np.array(tilted.gravity_vector)
        np.testing.assert_allclose(robot.contacts.floor_force, weight, rtol=1e-5)
    with pytest.raises(ValueError, match=r"floor_tilt = \[0.03, -0.04\], but it requires zeros"):
        Ballbot(tilted, model="planar")
    with pytest.raises(ValueError, match="yaw"):
        tilted.holding_torques(np.nan)
    with pytest.raises(ValueError, match="no lean holds the robot"):
        paper.replace(floor_tilt=(0.5, 0.0), body_com_height=0.05).slope_lean()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("how", ["snapshot", "pickle", "deepcopy"])
def test_a_copy_continues_bit_identically(model, how):
    robot = Ballbot(model=model, sim_dt=0.002)
    robot.set_params(robot.params.replace(wheel_viscous_friction=0.001, wheel_coulomb_friction=0.002))
    robot.reset(State.at_rest(robot.params, tilt=(0.03, -0.02), yaw=1.0))
    robot.step(TORQUES, 40)
    robot.push((0.05, 0.02, 0.0))
    if how == "snapshot":
        twin = Ballbot(robot.params, model=model, sim_dt=0.002)
        twin.restore(robot.snapshot())
    else:
        twin = pickle.loads(pickle.dumps(robot)) if how == "pickle" else copy.deepcopy(robot)
    assert twin.params == robot.params
    for steps in (1, 2, 60):
        robot.step(TORQUES, steps)
        twin.step(TORQUES, steps)
        assert twin.state == robot.state
        assert twin.time == robot.time
        np.testing.assert_array_equal(twin.contacts.wheel_tractions, robot.contacts.wheel_tractions)
    twin.step((0, 0, 0))
    assert twin.time > robot.time


def test_a_copy_keeps_its_parameters():
    robot = Ballbot(Params.paper().replace(body_mass=3.0), "spatial", 0.002)
    again = pickle.loads(pickle.dumps(robot))
    assert (again.params.body_mass, again.model, again.sim_dt) == (3.0, "spatial", 0.002)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("snapshot", [b"", b"abc", b"\xff" * 500], ids=["empty", "short", "ones"])
def test_bytes_that_are_not_a_snapshot_are_rejected(model, snapshot):
    robot = Ballbot(model=model)
    robot.step(TORQUES, 5)
    before = robot.state
    with pytest.raises(ValueError, match="cannot decode snapshot"):
        robot.restore(snapshot)
    assert robot.state == before


def test_snapshots_of_other_robots_are_rejected():
    snapshots = [Ballbot(model=model).snapshot() for model in MODELS]
    for i, model in enumerate(MODELS):
        for snapshot in [*snapshots[:i], *snapshots[i + 1 :], bytes(20_000)]:
            with pytest.raises(ValueError, match="cannot decode snapshot"):
                Ballbot(model=model).restore(snapshot)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("impulse", [1e3, 1e4])
def test_divergence_is_reported_and_a_reset_recovers(model, impulse):
    robot = Ballbot(model=model)
    robot.push((impulse, 0.0, 0.0))
    with pytest.raises(DivergedError, match=r"diverged at t = [0-9.]+ s: .* (limit|not finite)"):
        robot.step((0, 0, 0), 200)
    with pytest.raises(DivergedError):
        robot.step((0, 0, 0))
    assert np.isfinite(robot.state.to_array()).all()
    assert np.isfinite(robot.energy)
    new = Ballbot(model=model)
    for fixed in (robot, new):
        fixed.reset(State.at_rest(fixed.params, tilt=(0.01, 0.0)))
        fixed.step(TORQUES, 50)
    assert robot.state == new.state


def test_a_falling_robot_ends_on_the_floor():
    robot = Ballbot()
    robot.reset(State.at_rest(robot.params, tilt=(0.3, 0.0)))
    assert not robot.contacts.bot_on_floor
    robot.step((0, 0, 0), 2000)
    assert robot.contacts.bot_on_floor
    assert np.rad2deg(robot.state.tilt) > 60
    assert robot.state.body_position[2] > -0.05, "the robot sank into the floor"
    # All weight rests on the floor: the ball carries at least its own weight.
    assert robot.contacts.floor_force[2] > 0.99 * 1.437 * 9.81


def test_too_much_torque_makes_wheels_slip():
    robot = Ballbot()
    robot.step((5.0, 5.0, 5.0), 50)
    slip = robot.contacts.wheel_slip_speeds
    assert np.abs(slip).max() > 0.1
    assert robot.contacts.friction_utilization.max() > 0.9


def test_a_damaged_snapshot_is_rejected():
    robot = Ballbot()
    robot.step(TORQUES, 5)
    whole = robot.snapshot()
    for i in range(0, len(whole), 997):
        damaged = bytearray(whole)
        damaged[i] ^= 7
        with pytest.raises(ValueError, match="cannot decode snapshot of a robot"):
            robot.restore(bytes(damaged))
    robot.restore(whole)


@pytest.mark.parametrize("model", MODELS)
def test_time_is_the_number_of_steps(model):
    robot = Ballbot(model=model)
    for _ in range(3):
        robot.step((0, 0, 0), 7)
    assert robot.time == 21 * 0.001


def test_a_long_run_that_diverges_stops_where_it_does():
    robot = Ballbot(model="spatial")
    robot.push((1e3, 0.0, 0.0))
    with pytest.raises(DivergedError, match=f"t = {robot.sim_dt * 64}"):
        robot.step((0, 0, 0), 100_000)
    assert robot.time == pytest.approx(0.064)


def test_an_inverted_body_is_tilted_by_half_a_turn():
    inverted = State((0, 0, 0.112), body_quaternion=(0, 1, 0, 0))
    assert inverted.tilt == pytest.approx(np.pi)
    assert np.linalg.norm(inverted.tilt_components) == pytest.approx(np.pi)
