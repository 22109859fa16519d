"""Tasks whose robots move in MuJoCo."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.engines.engine_batch import EngineBatch
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.envs._batch_env import new_batch
from tests.support import commands

pytest.importorskip("mujoco")

from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate


@pytest.mark.parametrize("task", ["balance", "velocity", "goal", "path", "push"])
def test_a_regulator_behaves_alike_in_both_engines(task):
    """Every measure of three seconds within 2 %, but for what MuJoCo's soft contacts let sink."""
    options = {"max_episode_steps": 300}
    if task == "push":
        options["push"] = (0.0, 0.2)
    here, there = (
        bb.compare(["lqr"], task=task, episodes=3, seed=7, **options, engine=engine)[0] for engine in (None, "mujoco")
    )
    assert there.model == "mujoco"
    assert there.survival_rate == here.survival_rate == 1.0
    assert there.tilt_rms == pytest.approx(here.tilt_rms, rel=0.02)
    assert there.torque_rms == pytest.approx(here.torque_rms, rel=0.02)
    assert there.mean_reward == pytest.approx(here.mean_reward, rel=0.02)


def test_robots_sampled_by_an_event_are_the_robots_that_move():
    """A heavier body falls at another rate; its robot is made again in each episode."""
    events = [{"term": "body_com_height", "mode": "reset", "op": "abs", "dist": "uniform", "range": [0.1, 0.3]}]
    options = {"events": events, "max_episode_steps": 20, "reset_tilt": 0.0, "reset_tilt_rate": 0.0}
    start = bb.State.at_rest(bb.Params.paper(), (0.05, 0.0))
    tilts = {}
    for engine in (None, "mujoco"):
        batch = new_batch(4, autoreset="disabled", seed=3, options=options)
        batch = batch if engine is None else EngineBatch(batch, engine)
        for episode in range(2):
            batch.reset(starts=[start] * 4)
            for _ in range(20):
                batch.step(np.zeros((4, 3)))
            tilts[engine, episode] = [batch.state(i).tilt for i in range(4)]
    for episode in range(2):
        np.testing.assert_allclose(tilts["mujoco", episode], tilts[None, episode], rtol=5e-3)
    assert np.ptp(tilts[None, 0]) > 1e-3
    assert not np.allclose(tilts[None, 0], tilts[None, 1], rtol=1e-2)


def test_parameters_that_are_set_change_the_motion():
    params = bb.Params.paper()
    lower = params.replace(body_com_height=0.5 * params.body_com_height)
    start = bb.State.at_rest(params, (0.05, 0.0))
    tilts = []
    for first in (params, lower):
        batch = EngineBatch(new_batch(1, autoreset="disabled", options={"robot": first}), "mujoco")
        for robot in (first, lower):
            batch.set_params(0, robot)
            batch.reset(starts=[start])
            for _ in range(20):
                batch.step(np.zeros((1, 3)))
        tilts.append(batch.state(0).tilt)
    assert tilts[0] == tilts[1]
    for name in ("roller_friction", "roller_ripple"):
        batch.set_params(0, params.replace(**{name: 0.001}))
        with pytest.raises(ValueError, match=rf"{name} = 0.001: it must be 0"):
            batch.step(np.zeros((1, 3)))


def pressed(weights):
    params = bb.Params.paper()
    return params.replace(wheel_preload=weights * params.body_mass * params.gravity)


def test_a_preload_adds_the_same_loads_in_both_engines():
    for weights in (0.0, 1.0):
        params = pressed(weights)
        there = MujocoRobot(robot_geometry(params), accurate())
        here = bb.Ballbot(params, sim_dt=1e-3)
        start = bb.State.at_rest(params, (0.03, -0.02))
        for robot in (there, here):
            robot.reset(start)
            robot.step(np.array([0.05, -0.03, 0.02]), 200)
        # Its contacts are soft.
        np.testing.assert_allclose(there.wheel_loads(), here.contacts.wheel_normal_forces, rtol=5e-3)
        assert abs(there.state().tilt - here.state.tilt) <= 5e-3 * here.state.tilt


def test_a_preload_holds_wheels_that_slip_without_it_in_both_engines():
    speeds = {}
    for engine in (None, "mujoco"):
        for weights in (0.0, 1.0):
            params = pressed(weights).replace(wheel_static_friction=0.3, wheel_dynamic_friction=0.3)
            batch = new_batch(1, autoreset="disabled", options={"robot": params, "max_wheel_torque": 0.3})
            batch = batch if engine is None else EngineBatch(batch, engine)
            batch.reset(starts=[bb.State.at_rest(params)])
            for _ in range(3):
                batch.step(np.ones((1, 3)))
            speeds[engine, weights] = batch.state(0).wheel_speeds[0]
    assert speeds["mujoco", 1.0] == pytest.approx(speeds[None, 1.0], rel=0.02)
    assert all(speeds[engine, 0.0] > 2.0 * speeds[engine, 1.0] for engine in (None, "mujoco"))


@pytest.mark.parametrize("angle", [np.pi / 4, -0.3])
def test_inclined_rollers_move_the_robot_alike_in_both_engines(angle):
    params = bb.Params.paper().replace(roller_angle=angle, body_com_offset=(0.003, -0.002))
    start = bb.State.at_equilibrium(params, (0.03, -0.02), 0.4)
    torques = np.array([0.05, -0.03, 0.06])
    found = []
    for robot in (MujocoRobot(robot_geometry(params), accurate(2e-4)), bb.Ballbot(params, sim_dt=2e-4)):
        robot.reset(start)
        robot.step(torques, 1000)
        found.append(robot.state() if isinstance(robot, MujocoRobot) else robot.state)
    theirs, ours = found
    straight = bb.Ballbot(params.replace(roller_angle=0.0), sim_dt=2e-4)
    straight.reset(start)
    straight.step(torques, 1000)
    for name in ("ball_position", "ball_velocity", "body_angular_velocity", "wheel_speeds"):
        expected = getattr(ours, name)
        effect = np.linalg.norm(getattr(straight.state, name) - expected)
        assert np.linalg.norm(getattr(theirs, name) - expected) < 0.02 * effect, name
    with pytest.raises(ValueError, match=r"roller_angle = .* must be 0"):
        MujocoRobot(robot_geometry(params), accurate(turned=False))


def test_motors_weakened_by_an_event_are_weak_in_the_engine():
    events = [{"term": "max_wheel_torque", "mode": "reset", "op": "abs", "dist": "uniform", "range": [0.02, 0.021]}]
    speeds = []
    for engine in (None, "mujoco"):
        batch = new_batch(1, seed=3, options={"events": events})
        batch = batch if engine is None else EngineBatch(batch, engine)
        batch.reset(starts=[bb.State.at_rest(bb.Params.paper())])
        for _ in range(5):
            batch.step(np.ones((1, 3)))
        speeds.append(batch.state(0).wheel_speeds)
    np.testing.assert_allclose(speeds[1], speeds[0], rtol=0.02)


def test_a_state_that_diverges_ends_its_episode(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    batch = EngineBatch(new_batch(2, autoreset="disabled", seed=1), "mujoco")
    batch.reset()
    pushes = np.random.default_rng(0)
    for _ in range(40):
        batch.push(0, pushes.uniform(-1000.0, 1000.0, 3), pushes.uniform(-0.3, 0.3, 3))
        _, _, terminated, _ = batch.step(np.zeros((2, 3)))
        if terminated[0]:
            break
    assert terminated.tolist() == [True, False]
    assert batch.ending(0)[1] in ("tilt", "diverged", "bot_on_floor")
    batch._robots[1][1].data.qpos[0] = np.nan
    batch._robots[1][1].step(np.zeros(3), 5)
    assert np.isnan(batch._robots[1][1].row()).any()
    assert not list(tmp_path.iterdir())


def test_a_task_in_python_runs_in_the_engine():
    class Upright(bb.Task):
        def observe(self, robots):
            return robots.gravity

        def reward(self, robots):
            return 1.0 - robots.tilt

        def terminated(self, robots):
            return robots.tilt > 0.4

    bb.register("tests/Upright-v0", Upright)
    options = {"max_episode_steps": 50}
    here, there = (
        bb.compare(["zero"], task="tests/Upright-v0", episodes=3, **options, engine=engine)[0]
        for engine in (None, "mujoco")
    )
    assert there.mean_reward == pytest.approx(here.mean_reward, rel=1e-2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"actuators": {"delay": 0.01}}, "ideal motors"),
        ({"robot": "kugle"}, "ball_viscous_friction = 0.001"),
        ({"events": "mild"}, "ball_viscous_friction, which an event changes"),
        (
            {
                "events": [
                    {
                        "term": "gravity",
                        "mode": "at",
                        "at": 0.05,
                        "op": "scale",
                        "dist": "uniform",
                        "range": [0.5, 0.6],
                    }
                ]
            },
            "does not change gravity within an episode",
        ),
        ({"model": "rigid"}, "replaces model = 'rigid'"),
    ],
)
def test_features_that_the_engine_does_not_simulate_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        bb.compare(["lqr"], episodes=1, **options, engine="mujoco")


def test_an_unknown_engine_is_rejected():
    with pytest.raises(ValueError, match="unknown engine 'mujocoo': expected one of mujoco"):
        bb.compare(["lqr"], episodes=1, engine="mujocoo")


def test_the_command_names_the_engine():
    done = commands.run("evaluate", "--engine", "mujoco", "--episodes", "2", "--set", "max_episode_steps=50")
    assert done.returncode == 0, done.stderr
    assert "model mujoco" in done.stdout
