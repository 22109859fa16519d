"""What inclined rollers do to laws, limits and batches, and what rejects them."""

import math

import numpy as np
import pytest

import ballbot_rs as bb

ROBOTS = ("paper", "kugle", "rezero", "asroballet")


def inclined(name, angle=math.pi / 4):
    return bb.Params.preset(name).replace(roller_angle=angle)


@pytest.mark.parametrize("angle", [math.pi / 4, -math.pi / 4])
@pytest.mark.parametrize("law", ["lqr", "lqr_pi", "cascade_pid", "pd_inverse_dynamics"])
@pytest.mark.parametrize("name", ROBOTS)
def test_laws_balance_every_robot_at_45_degrees(name, law, angle):
    params = inclined(name, angle)
    controller = bb.Controller(law, params, 0.01)
    robot = bb.Ballbot(params)
    robot.reset(bb.State.at_rest(params, (0.03, -0.02)))
    for _ in range(1500):
        robot.step(controller(robot.state), round(0.01 / robot.sim_dt))
    # The dry friction of asRoBallet's wheel joints leaves a small limit cycle, with omniwheels too.
    assert robot.state.tilt < 0.015
    assert np.linalg.norm(robot.state.ball_velocity) < 0.08
    assert np.linalg.norm(robot.state.ball_position[:2]) < 0.1


@pytest.mark.parametrize("name", ROBOTS)
def test_inclined_rollers_are_a_gear(name):
    """Of the torque for a tilt torque: cos α / sqrt(cos² α + tan² γ) of an omniwheel's; of a yaw torque the same."""
    for angle in (-0.3, math.pi / 4):
        straight, params = bb.Params.preset(name), inclined(name, angle)
        cosine = math.cos(params.wheel_zenith)
        share = cosine / math.hypot(cosine, math.tan(angle))
        for axis in ((1.0, 0.0, 0.0), (0.3, -0.8, 0.0)):
            of_both = [np.linalg.norm(bb.virtual_to_wheel_torques(one, axis)) for one in (straight, params)]
            assert of_both[1] == pytest.approx(share * of_both[0], rel=1e-12)
        yaw = [bb.virtual_to_wheel_torques(one, (0.0, 0.0, 1.0)) for one in (straight, params)]
        np.testing.assert_allclose(yaw[1], yaw[0], rtol=1e-12)


def test_a_batch_of_other_angles_is_the_robots_alone():
    """To the last bit, next to robots without an angle."""
    events = [{"term": "roller_angle", "mode": "startup", "range": [-0.6, 0.6]}]
    batch = bb.Batch(16, seed=1, max_wheel_torque=0.8, events=events)
    others = [bb.Batch(1, seed=1 + i, max_wheel_torque=0.8, robot=batch.params(i)) for i in range(16)]
    assert len({batch.params(i).roller_angle for i in range(16)}) == 16
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


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("model", ["spatial", "contact"])
def test_derivatives_with_respect_to_the_angle(model, angle):
    params = bb.Params.paper().replace(roller_angle=angle)
    start = bb.State.at_rest(params, (0.03, -0.02), 0.3)
    torques, steps, change = np.array([0.05, -0.03, 0.06]), 20, 1e-5

    def moved(by):
        robot = bb.Ballbot(params.replace(roller_angle=angle + by), model)
        robot.reset(start)
        return robot

    found = moved(0.0).jacobian(torques, steps, ["roller_angle"])
    ends = []
    for sign in (1.0, -1.0):
        robot = moved(sign * change)
        robot.step(torques, steps)
        ends.append(robot.state)
    for names, field in (("ball_velocity", "ball_velocity"), ("wheel_speed", "wheel_speeds")):
        rows = [i for i, name in enumerate(found.states) if name.startswith(names)]
        expected = (getattr(ends[0], field) - getattr(ends[1], field)) / (2.0 * change)
        # Without slip the velocity has no third component.
        np.testing.assert_allclose(found.P[rows, 0], expected[: len(rows)], rtol=2e-4, atol=1e-5)


def test_what_is_of_omniwheels_rejects_the_angle():
    params = inclined("paper")
    assert not params.is_symmetric
    with pytest.raises(ValueError, match=r"roller_angle = 0.785.* rad, but it requires 0"):
        bb.Ballbot(params, "planar")
    with pytest.raises(ValueError, match=r"eq\. \(8\) as printed is for omniwheels.*roller_angle"):
        bb.virtual_to_wheel_torques(params, (1.0, 0.0, 0.0), "as_printed")
