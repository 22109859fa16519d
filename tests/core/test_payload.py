"""Payloads that move on the body."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.envs._batch_env import new_batch


def tray(name, share=0.1, hertz=2.0, ratio=0.05):
    """A preset with a payload of a fraction of its body at 1.5 times the height of its CoM."""
    params = bb.Params.preset(name)
    mass = share * params.body_mass
    stiffness = mass * (2.0 * np.pi * hertz) ** 2
    return params.with_payload(
        mass,
        position=(0.0, 0.0, 1.5 * params.body_com_height),
        stiffness=stiffness,
        damping=2.0 * ratio * np.sqrt(stiffness * mass),
    )


def test_with_payload_adds_a_mass_and_without_payloads_takes_it_off():
    paper = bb.Params.paper()
    robot = paper.with_payload(1.0, position=[0.0, 0.0, 0.4], stiffness=[300.0, 300.0, 3000.0], damping=3)
    assert robot.has_payload
    assert not paper.has_payload
    assert robot.body_mass == paper.body_mass + 1.0
    assert robot.payload_damping == (3.0, 3.0, 3.0)
    com = (paper.body_mass * paper.body_com_height + 0.4) / robot.body_mass
    assert robot.body_com_height == pytest.approx(com, rel=1e-14)
    assert robot.without_payloads().body_mass == pytest.approx(paper.body_mass, rel=1e-14)
    assert robot.without_payloads().body_inertia == pytest.approx(paper.body_inertia, rel=1e-12)
    fixed = robot.with_payloads_fixed()
    assert (fixed.payload_mass, fixed.body_mass) == (0.0, robot.body_mass)
    # The place and the springs are kept.
    assert robot.with_payload(2.0).payload_position == (0.0, 0.0, 0.4)
    assert bb.Params.from_toml(robot.to_toml()) == robot


def test_a_second_payload_comes_with_a_first():
    paper = bb.Params.paper()
    one = paper.with_payload(1.0, position=[0.0, 0.0, 0.4], stiffness=300.0)
    two = one.with_payload(0.5, position=[0.1, 0.0, 0.2], stiffness=[50.0, 60.0, 70.0], damping=1.0, payload=1)
    assert (two.second_payload_stiffness, two.second_payload_damping) == ((50.0, 60.0, 70.0), (1.0, 1.0, 1.0))
    assert two.body_mass == pytest.approx(paper.body_mass + 1.5, rel=1e-14)
    alone = two.without_payloads()
    assert (alone.payload_mass, alone.second_payload_mass) == (0.0, 0.0)
    assert alone.body_inertia == pytest.approx(paper.body_inertia, rel=1e-12)
    assert (two.with_payloads_fixed().second_payload_mass, two.with_payloads_fixed().body_mass) == (0.0, two.body_mass)
    # Either is replaced, the other stays.
    lighter = two.with_payload(0.2)
    assert (lighter.payload_mass, lighter.second_payload_mass) == (0.2, 0.5)
    assert lighter.without_payloads().body_inertia == pytest.approx(paper.body_inertia, rel=1e-12)
    put_down = two.with_payload(0.0, payload=1)
    assert put_down.body_com == pytest.approx(one.body_com, rel=1e-12)
    assert bb.Params.from_toml(two.to_toml()) == two
    with pytest.raises(ValueError, match="there must be a first payload"):
        paper.with_payload(0.5, stiffness=10.0, payload=1)
    with pytest.raises(ValueError, match="there must be a first payload"):
        two.with_payload(0.0)
    with pytest.raises(ValueError, match="payload = 2 must be 0, or 1"):
        paper.with_payload(0.5, stiffness=10.0, payload=2)


@pytest.mark.parametrize("model", ["contact", "spatial", "rigid"])
def test_two_arms_that_swing_apart_turn_the_body_about_its_mast(model):
    """The forces of the arms on the body are a couple about the mast."""
    paper = bb.Params.paper()
    mass, arm, k = 0.05 * paper.body_mass, 0.15, 400.0
    springs = {"stiffness": k, "damping": 2.0 * np.sqrt(k * mass)}
    robot = paper.with_payload(mass, position=(arm, 0.0, 0.3), **springs)
    robot = robot.with_payload(mass, position=(-arm, 0.0, 0.3), **springs, payload=1)
    ballbot = bb.Ballbot(robot, model=model)
    law = bb.Lqr(robot, control_dt=0.01)
    for sign, payload in ((1.0, 0), (-1.0, 1)):
        ballbot.move_payload((0.0, sign * 0.05, 0.0), payload=payload)
    for _ in range(5):
        ballbot.step(law(ballbot.state), steps=10)
    first, second = ballbot.payloads
    np.testing.assert_allclose(first[:3], second[:3] * [-1.0, -1.0, 1.0], atol=1e-4)
    assert first[1] > 0.03
    assert ballbot.state.yaw < -0.04
    assert ballbot.state.tilt < 1e-3


def test_a_rigid_body_adds_its_inertia_to_the_body():
    paper = bb.Params.paper()
    load = {"position": [0.0, 0.0, 0.4], "stiffness": 300.0}
    point, solid = (paper.with_payload(1.0, **load, **more) for more in ({}, {"inertia": [0.01, 0.02, 0.015]}))
    np.testing.assert_allclose(np.subtract(solid.body_inertia, point.body_inertia), [0.01, 0.02, 0.015], atol=1e-15)
    assert solid.replace(body_inertia=point.body_inertia) == point
    ball = paper.with_payload(1.0, **load, inertia=0.01)
    np.testing.assert_allclose(np.subtract(ball.body_inertia, point.body_inertia), 0.01, atol=1e-15)
    # It turns with the body, so it stays with the body.
    kept = np.subtract(ball.without_payloads().body_inertia, paper.body_inertia)
    np.testing.assert_allclose(kept, 0.01, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mass": 1.0, "stiffness": 1.0, "inertia": [0.01, 0.01]}, "inertia has 2 values, expected 3"),
        ({"mass": 1.0, "stiffness": 1.0, "inertia": -0.1}, r"inertia\[0\] = -0.1 is out of range: .* from 0 to"),
        ({"mass": 1.0, "stiffness": 1.0, "inertia": [0.1, 0.01, 0.01]}, r"inertia\[0\] = 0.1 is out of range: .* 0.02"),
        ({"mass": float("nan")}, "mass = NaN"),
        ({"mass": -3.0}, "body_mass"),
        ({"mass": 1.0}, r"payload_stiffness\[0\] = 0"),
        ({"mass": 1.0, "stiffness": [1.0, 2.0]}, "payload_stiffness"),
        ({"mass": 1.0, "stiffness": 1.0, "position": [0.0, 0.0]}, "payload_position"),
    ],
)
def test_invalid_payloads_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.Params.paper().with_payload(**arguments)


@pytest.mark.parametrize("name", bb.Params.preset_names())
@pytest.mark.parametrize("model", ["contact", "spatial"])
@pytest.mark.parametrize("law", ["lqr", "lqr_pi", "cascade_pid"])
def test_laws_balance_a_robot_whose_payload_sways(name, model, law):
    params = tray(name)
    robot = bb.Ballbot(params, model=model)
    controller = bb.make_controller(law, params, control_dt=0.01)
    robot.reset(bb.State.at_equilibrium(params, tilt=(0.03, -0.02)))
    swayed = 0.0
    for _ in range(1000):
        robot.step(controller(robot.state), steps=10)
        swayed = max(swayed, float(np.abs(robot.payloads[0, :3]).max()))
    assert swayed > 1e-4
    assert robot.state.tilt < 0.02
    # The bearings of some robots keep them rolling.
    assert np.abs(robot.payloads[0, :3]).max() < 0.5 * swayed


def test_a_law_that_does_not_expect_the_payload_balances_as_well():
    params = tray("paper", share=0.3)
    robot = bb.Ballbot(params)
    law = bb.Lqr(params.without_payloads(), control_dt=0.01)
    robot.reset(bb.State.at_equilibrium(params, tilt=(0.02, 0.0)))
    for _ in range(1000):
        robot.step(law(robot.state), steps=10)
    assert robot.state.tilt < 0.02


def test_a_batch_reads_the_payloads_of_its_robots():
    params = tray("paper")
    batch = new_batch(3, autoreset="disabled", options={"robot": params})
    start = bb.State.at_rest(params, (0.05, 0.0))
    batch.reset(starts=[start] * 3)
    np.testing.assert_allclose(batch.payloads(), np.zeros((3, 2, 6)), atol=1e-15)
    alone = bb.Ballbot(params, sim_dt=batch.sim_dt)
    alone.reset(start)
    for _ in range(5):
        batch.step(np.zeros((3, 3)))
    alone.step(np.zeros(3), steps=round(5 * batch.control_dt / batch.sim_dt))
    np.testing.assert_array_equal(batch.payloads(), np.tile(alone.payloads, (3, 1, 1)))
    assert np.abs(alone.payloads).max() > 0.0


@pytest.mark.parametrize("model", ["contact", "spatial", "rigid"])
def test_deflections_are_set_and_read(model):
    params = tray("paper")
    rng = np.random.default_rng(0)
    batch = new_batch(9, autoreset="disabled", options={"robot": params, "model": model})
    batch.set_params(4, params.without_payloads())
    for i in range(5, 9):
        batch.set_params(i, params.with_payload(0.1, position=(0.1, 0.0, 0.2), stiffness=30.0, payload=1))
    robots = [batch.params(i) for i in range(9)]
    batch.reset(starts=[bb.State.at_rest(one, (0.05, 0.02)) for one in robots])
    deflections = 0.02 * rng.standard_normal((9, 2, 6))
    deflections[4] = 0.0
    deflections[:5, 1] = 0.0
    batch.set_payloads(deflections)
    np.testing.assert_allclose(batch.payloads(), deflections, atol=1e-14)
    batch.step(np.zeros((9, 3)))
    for i in (0, 8):
        alone = bb.Ballbot(robots[i], model=model, sim_dt=batch.sim_dt)
        alone.reset(bb.State.at_rest(robots[i], (0.05, 0.02)))
        alone.set_payloads(deflections[i])
        alone.step(np.zeros(3), steps=round(batch.control_dt / batch.sim_dt))
        np.testing.assert_array_equal(batch.payloads()[i], alone.payloads)
        np.testing.assert_array_equal(batch.state(i).to_array(), alone.state.to_array())
    before = batch.payloads()
    for place, value, message in (
        ((4, 0), 0.1, r"payloads\[4\]\[0\] must be zero: the robot has no such payload, payload_mass is 0"),
        ((0, 1), 0.1, r"payloads\[0\]\[1\] must be zero: the robot has no such payload, second_payload_mass is 0"),
        ((7, 1), np.nan, r"payloads\[7\]\[1\]\[0\] = NaN"),
        ((7, 1), 2000.0, r"payloads\[7\]\[1\]\[0\] = 2000 is out of range: it must be within ±1000"),
    ):
        bad = np.zeros((9, 2, 6))
        bad[(*place, 0)] = value
        with pytest.raises(ValueError, match=message):
            batch.set_payloads(bad)
    with pytest.raises(ValueError, match=r"payloads has shape \(9, 6\), expected \(9, 2, 6\)"):
        batch.set_payloads(np.zeros((9, 6)))
    np.testing.assert_array_equal(batch.payloads(), before)


def test_events_load_robots_and_laws_stay_nominal():
    robot = bb.Params.paper().replace(
        payload_position=(0.0, 0.0, 0.4), payload_stiffness=(300.0,) * 3, payload_damping=(3.0,) * 3
    )
    events = [{"term": "payload_mass", "range": [0.2, 0.6]}]
    found = bb.compare(["lqr"], robot=robot, events=events, episodes=20, seed=2)[0]
    assert found.survival_rate == 1.0
    with pytest.raises(ValueError, match="without payload_mass it changes nothing"):
        bb.compare(["lqr"], events=[{"term": "payload_damping", "range": [1.0, 2.0]}], episodes=1)


def test_what_has_no_payload_rejects_one():
    params = tray("paper")
    with pytest.raises(ValueError, match="payload_mass"):
        bb.Ballbot(params, model="planar")
    with pytest.raises(ValueError, match="derivatives of motions: payload_mass"):
        bb.Ballbot(params).jacobian(np.zeros(3))


def test_a_payload_taken_off_leaves_the_robot_as_it_was():
    paper = bb.Params.paper()
    robot = paper.with_payload(1.0, position=(0.02, -0.01, 0.4), stiffness=300.0).with_payload(0.0)
    assert robot.is_symmetric
    assert robot.body_inertia == pytest.approx(paper.body_inertia, rel=1e-12)


def test_scales_take_the_payload_as_fixed():
    robot = tray("paper", share=0.5)
    assert bb.Scale.of(robot) == bb.Scale.of(robot.with_payloads_fixed())


@pytest.mark.parametrize("model", ["contact", "spatial", "rigid"])
@pytest.mark.parametrize("name", ["paper", "kugle"])
def test_a_rider_who_leans_tilts_the_robot_until_the_moments_balance(name, model):
    """At rest without torque, the CoM of body and payload is above the ball."""
    losses = ("wheel_coulomb_friction", "roller_friction", "floor_rolling_friction", "floor_spinning_friction")
    params = tray(name, share=0.3, hertz=2.5, ratio=0.3).replace(**dict.fromkeys(losses, 0.0))
    alone, (height, mass) = params.without_payloads(), (params.payload_position[2], params.payload_mass)
    stiffness = params.payload_stiffness[0]
    weight = mass * params.gravity
    offset = 0.1 * params.body_com_height

    def moment(tilt):
        """About the ball, forward; the springs hold the weight of the payload while the robot is upright."""
        along, up = offset + weight * np.sin(tilt) / stiffness, height + weight * (1.0 - np.cos(tilt)) / stiffness
        body = alone.body_mass * alone.body_com_height * np.sin(tilt)
        return body + mass * (up * np.sin(tilt) + along * np.cos(tilt))

    low, high = -0.5, 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if moment(middle) < 0.0 else (low, middle)
    ballbot = bb.Ballbot(params, model=model)
    law = bb.Lqr(params, control_dt=0.01)
    for sign, axis in ((1.0, 0), (-1.0, 1)):
        lean = np.zeros(3)
        lean[axis] = sign * offset
        ballbot.reset()
        ballbot.move_payload(lean)
        for _ in range(3000):
            ballbot.step(law(ballbot.state), steps=round(0.01 / ballbot.sim_dt))
        tilt = ballbot.state.tilt_components
        # A rotation vector: about y the robot leans along x, about x against y.
        expected = sign * middle * np.array([-1.0, 0.0] if axis else [0.0, 1.0])
        np.testing.assert_allclose(tilt, expected, atol=2e-4)
        assert ballbot.payloads[0, axis] == pytest.approx(
            sign * (offset + weight * np.sin(middle) / stiffness), abs=1e-3 * offset
        )


def test_offsets_of_a_payload_are_checked():
    ballbot = bb.Ballbot(tray("paper"))
    for offset, message in (([0.0, np.nan, 0.0], r"offset\[1\] = NaN"), ([1e4, 0.0, 0.0], r"offset\[0\] = 10000")):
        with pytest.raises(ValueError, match=message):
            ballbot.move_payload(offset)
    with pytest.raises(ValueError, match="payload_mass = 0"):
        bb.Ballbot().move_payload([0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="second_payload_mass = 0"):
        ballbot.move_payload([0.0, 0.0, 0.0], payload=1)
    for payload in (2, -1):
        with pytest.raises(ValueError, match=f"payload = {payload} must be 0, or 1"):
            ballbot.move_payload([0.0, 0.0, 0.0], payload=payload)
    batch = bb.Batch(2, robot=tray("paper"))
    with pytest.raises((ValueError, IndexError)):
        batch.move_payload(2, [0.0, 0.0, 0.0])


@pytest.mark.parametrize("share", [0.9, 1.12])
def test_laws_with_equal_poles_in_both_planes_are_stable(share):
    """Rounding makes the discriminant of a block of the Schur form positive: its poles were NaN."""
    robot = tray("rezero", share, 1.0).with_payloads_fixed()
    law = bb.make_controller("cascade_pid", robot, control_dt=0.01)
    assert bb.simulate(law, robot=robot, tilt=(0.02, 0.0), seconds=2.0).fell_at is None
