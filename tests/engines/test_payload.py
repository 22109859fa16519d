"""Payloads that move on the body, in MuJoCo and here."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.envs.family import sample_robots

pytest.importorskip("mujoco")

import mujoco

from ballbot_rs.engines.mujoco_robot import PAYLOADS, MujocoRobot, accurate

SIM_DT = 2e-4
#: Robots whose body without wheels has an inertia that MuJoCo takes.
SEEDS = [seed for seed in range(23) if seed not in (0, 13, 18)]


def loaded(seed, count=1):
    """A robot of the family with payloads of up to 60 and 20 % of its body, off the mast, soft along every axis."""
    rng = np.random.default_rng(seed)
    params = sample_robots(1, seed=seed)[0].replace(
        ball_viscous_friction=0.0,
        roller_friction=0.0,
        floor_rolling_friction=0.0,
        floor_spinning_friction=0.0,
        # MuJoCo's is not the same at rest.
        wheel_coulomb_friction=0.0,
    )
    for index, most in enumerate((0.6, 0.2)[:count]):
        mass = rng.uniform(0.05, most) * params.body_mass
        height = rng.uniform(0.5, 2.0) * params.body_com_height
        hertz = rng.uniform(1.0, 5.0, 3)
        stiffness = mass * (2.0 * np.pi * hertz) ** 2
        params = params.with_payload(
            mass,
            position=(*rng.uniform(-0.1, 0.1, 2) * height, height),
            stiffness=stiffness,
            damping=2.0 * rng.uniform(0.0, 0.3) * np.sqrt(stiffness * mass),
            payload=index,
        )
    return params


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_robots_with_payloads_move_alike_in_both_engines(seed, count):
    params = loaded(seed, count)
    start = bb.State.at_equilibrium(params, tilt=(0.03, -0.02))
    there, here = MujocoRobot(robot_geometry(params), accurate(SIM_DT)), bb.Ballbot(params, sim_dt=SIM_DT)
    fixed = bb.Ballbot(params.with_payloads_fixed(), sim_dt=SIM_DT)
    for robot in (there, here, fixed):
        robot.reset(start)
    limit = 0.02 * min(params.max_wheel_torque, params.scale("N·m"))
    largest = error = effect = 0.0
    for k in range(50):
        torques = limit * np.sin(0.3 * k + np.arange(3.0))
        for robot in (there, here, fixed):
            robot.step(torques, 20)
        found, expected = here.payloads[:count, :3].ravel(), there.data.qpos[PAYLOADS]
        largest = max(largest, float(np.abs(expected).max()))
        error = max(error, float(np.abs(found - expected).max()))
        effect = max(effect, abs(here.state.tilt - fixed.state.tilt))
        assert abs(here.state.tilt - there.state().tilt) <= 0.02 * here.state.tilt, k
    assert error <= 0.02 * largest
    # The payload matters.
    assert effect > 1e-4 * start.tilt


@pytest.mark.parametrize("seed", SEEDS[:4])
def test_a_rigid_body_on_springs_has_its_inertia_in_the_body(seed):
    """It turns with the body: in MuJoCo with its own inertia, here a point on a body with more inertia."""
    point = loaded(seed)
    alone = point.without_payloads()
    inertia = np.array([0.5, 0.4, 0.3]) * np.mean(alone.body_inertia)
    solid = alone.with_payload(point.payload_mass, inertia=inertia)
    there = MujocoRobot(robot_geometry(point), accurate(SIM_DT))
    there.model.body_inertia[-1] += inertia
    mujoco.mj_setConst(there.model, there.data)
    here, other = bb.Ballbot(solid, sim_dt=SIM_DT), bb.Ballbot(point, sim_dt=SIM_DT)
    start = bb.State.at_equilibrium(point, tilt=(0.03, -0.02))
    for robot in (there, here, other):
        robot.reset(start)
    limit = 0.02 * min(point.max_wheel_torque, point.scale("N·m"))
    largest = error = effect = 0.0
    for k in range(50):
        torques = limit * np.sin(0.3 * k + np.arange(3.0))
        for robot in (there, here, other):
            robot.step(torques, 20)
        expected = there.data.qpos[PAYLOADS]
        largest = max(largest, float(np.abs(expected).max()))
        error = max(error, float(np.abs(here.payloads[0, :3] - expected).max()))
        effect = max(effect, float(np.abs(other.payloads[0, :3] - expected).max()))
        assert abs(here.state.tilt - there.state().tilt) <= 0.02 * here.state.tilt, k
    assert error <= 0.02 * largest
    # The inertia matters.
    assert effect > 3.0 * error


def test_the_engine_of_tasks_rejects_a_payload():
    robot = bb.Params.paper().with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=100.0)
    with pytest.raises(ValueError, match=r"payload_mass = 0\.5"):
        bb.compare(["lqr"], robot=robot, episodes=1, engine="mujoco")


def test_an_arm_is_rejected():
    for name in ("payload_amplitude", "second_payload_amplitude"):
        arm = loaded(1, 2).replace(**{name: (0.01, 0.0, 0.0)})
        with pytest.raises(ValueError, match=f"simulate {name}"):
            MujocoRobot(robot_geometry(arm), accurate(SIM_DT))
