"""What follows from the preload of the wheels: limits by traction, laws, events."""

import numpy as np
import pytest

import ballbot_rs as bb

ROBOTS = ("paper", "rezero")


def pressed(name, weights):
    # Motors that limit nothing.
    params = bb.Params.preset(name).replace(max_wheel_torque=1e3)
    return params.replace(wheel_preload=weights * params.body_mass * params.gravity)


@pytest.mark.parametrize("name", ROBOTS)
def test_limits_by_traction_grow_with_the_loads(name):
    """Loads at rest are 1 + P / (M_b g) times the loads without it, and tractions and their changes the same."""
    plain, twice = pressed(name, 0.0), pressed(name, 1.0)
    np.testing.assert_allclose(twice.equilibrium_wheel_loads, 2.0 * np.array(plain.equilibrium_wheel_loads), rtol=1e-12)
    before, after = bb.Scale.of(plain), bb.Scale.of(twice)
    assert after.holdable_lean == pytest.approx(2.0 * before.holdable_lean, rel=1e-9)
    assert after.capture_impulse == pytest.approx(2.0 * before.capture_impulse, rel=1e-9)
    assert after.toppling_rate == before.toppling_rate
    assert twice.scale("rad") == pytest.approx(2.0 * plain.scale("rad"), rel=1e-9)
    assert twice.scale("N·m") == plain.scale("N·m")
    assert plain.slope_limits()["traction"] < twice.slope_limits()["traction"]


@pytest.mark.parametrize("name", ROBOTS)
def test_actions_and_laws_use_the_traction(name):
    plain, twice = pressed(name, 0.0), pressed(name, 1.0)
    torques = [np.max(bb.Batch(1, robot=params).max_wheel_torque) for params in (plain, twice)]
    assert torques[1] == pytest.approx(2.0 * torques[0], rel=1e-9)
    start = bb.State.at_rest(plain, (0.3, 0.1))
    largest = [np.abs(bb.Lqr(params)(start)).max() for params in (plain, twice)]
    assert largest[1] > 1.2 * largest[0]


def test_an_event_on_the_preload_is_the_robot_with_it():
    """To the last bit, next to robots without it."""
    events = [{"term": "wheel_preload", "mode": "startup", "range": [0.0, 30.0]}]
    batch = bb.Batch(16, seed=1, max_wheel_torque=0.8, events=events)
    others = [bb.Batch(1, seed=1 + i, max_wheel_torque=0.8, robot=batch.params(i)) for i in range(16)]
    assert len({batch.params(i).wheel_preload for i in range(16)}) == 16
    start = bb.State.at_rest(bb.Params.paper(), (0.2, -0.1))
    batch.reset(starts=[start] * 16)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (30, 16, 3))
    for step in range(30):
        batch.step(actions[step])
    for i, other in enumerate(others):
        other.reset(starts=[start])
        for step in range(30):
            other.step(actions[step, i : i + 1])
        np.testing.assert_array_equal(batch.state(i).to_array(), other.state(0).to_array())


def test_a_preload_survives_files_and_snapshots(tmp_path):
    params = pressed("paper", 1.0)
    path = tmp_path / "robot.toml"
    path.write_text(params.to_toml(), encoding="utf-8")
    assert bb.Params.from_toml(path) == params
    robot = bb.Ballbot(params)
    robot.step([0.05, -0.03, 0.02], 20)
    saved = robot.snapshot()
    robot.step([0.05, -0.03, 0.02], 20)
    expected = robot.state, robot.contacts.wheel_normal_forces
    other = bb.Ballbot(params)
    other.restore(saved)
    other.step([0.05, -0.03, 0.02], 20)
    assert other.state == expected[0]
    np.testing.assert_array_equal(other.contacts.wheel_normal_forces, expected[1])
    assert expected[1][0] > 1.5 * bb.Params.paper().equilibrium_wheel_loads[0]


def test_an_event_on_the_preload_without_slip_is_rejected():
    events = [{"term": "wheel_preload", "range": [0.0, 10.0]}]
    with pytest.raises(ValueError, match="the model 'spatial' has no slip"):
        bb.Batch(1, model="spatial", events=events)
    bb.Batch(1, model="spatial", events=events, robot=bb.Params.paper().replace(roller_friction=0.01))
