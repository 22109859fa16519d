"""The law that yields to an external force, and the estimate of the force, from Python."""

import numpy as np
import pytest

import ballbot_rs as bb

PRESETS = bb.Params.preset_names()


def _batch(robot, num_envs, **options):
    defaults = {"model": "contact", "num_threads": 1, "max_wheel_torque": robot.max_wheel_torque, "seed": 3}
    batch = bb.Batch(num_envs, "balance", robot=robot, max_episode_steps=100_000, **{**defaults, **options})
    batch.reset(starts=[bb.State.at_equilibrium(robot)] * num_envs)
    return batch


def _run(batch, law, seconds):
    """Whether no robot falls, and the estimates of the forces, shape (steps, num_envs, 2)."""
    stands, forces = True, []
    for _ in range(round(seconds / law.control_dt)):
        _, _, terminated, _ = batch.step(batch.control(law, setpoints={"position": (0.0, 0.0)}))
        stands &= not terminated.any()
        forces.append(batch.outside_forces())
    return stands, np.array(forces)


def test_a_batch_estimates_what_the_controller_estimates():
    robot = bb.Params.paper()
    batch = _batch(robot, 2)
    law = bb.Controller("admittance")
    batch.apply_force(0, (0.5, -0.3, 0.0))
    _, forces = _run(batch, law, 3.0)
    assert np.linalg.norm(forces[-1, 0] - (0.5, -0.3)) < 0.01
    assert np.abs(forces[-1, 1]).max() < 1e-3
    alone = bb.Ballbot(robot)
    alone.reset(bb.State.at_equilibrium(robot))
    alone.apply_force((0.5, -0.3, 0.0))
    assert law.outside_force.tolist() == [0.0, 0.0]
    for _ in range(300):
        alone.step(law(alone.state, position=(0.0, 0.0)), 10)
    assert np.linalg.norm(law.outside_force - forces[-1, 0]) < 1e-3
    law.reset()
    assert law.outside_force.tolist() == [0.0, 0.0]
    batch.reset()
    assert not batch.outside_forces().any()


def test_laws_without_an_observer_estimate_nothing():
    batch = _batch(bb.Params.paper(), 1)
    assert batch.outside_forces() is None
    for law in (bb.Lqr(), bb.Controller("lqi")):
        batch.control(law)
        assert batch.outside_forces() is None
        assert law.outside_force is None
        assert law.outside_force_deviation(0.1, 0.1) is None
    observing = bb.Lqr(lean_observer=1.0)
    batch.control(observing)
    assert batch.outside_forces().shape == (1, 2)
    deviations = [observing.outside_force_deviation(*noise) for noise in ((0.01, 0.0), (0.0, 0.02))]
    assert np.min(deviations) > 0.0
    together = observing.outside_force_deviation(velocity=0.01, tilt_rate=0.02)
    np.testing.assert_allclose(together, np.linalg.norm(deviations, axis=0), rtol=1e-12)
    with pytest.raises(ValueError, match="velocity = -1"):
        observing.outside_force_deviation(-1.0, 0.0)


@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize("sensors", [None, "kugle"])
def test_it_holds_still_without_a_force(robot, sensors):
    """For 20 s, with exact states and with the estimator on noisy sensors."""
    params = bb.Params.preset(robot)
    options = {} if sensors is None else {"sensors": sensors, "observation": "sensors"}
    batch = _batch(params, 8, **options)
    stands, forces = _run(batch, bb.Controller("admittance", params), 20.0)
    moved = np.linalg.norm(batch.states()[:, :2], axis=1).max()
    largest = np.linalg.norm(forces[500:], axis=-1).max()
    print(f"{robot}, {sensors}: {1e3 * moved:.1f} mm, largest estimate {largest:.3g} N")
    assert stands
    assert moved < 0.03 * params.scale("m")


@pytest.mark.parametrize("robot", PRESETS)
def test_it_is_led_at_the_speed_of_a_helper(robot):
    """At 0.45 m/s, at which CMU's ballbot pushed a wheelchair (arXiv 2404.13206)."""
    params = bb.Params.preset(robot)
    force = 0.2 * params.scale("N") + 0.45 * 4.0 * params.scale("N·s/m")
    batch = _batch(params, 8)
    for i in range(8):
        angle = 2.0 * np.pi * i / 8
        point = (0.0, 0.0, 1.5 * params.body_com_height)
        batch.apply_force(i, (force * np.cos(angle), force * np.sin(angle), 0.0), point)
    stands, _ = _run(batch, bb.Controller("admittance", params), 12.0)
    speeds = [np.linalg.norm(batch.state(i).ball_velocity) for i in range(8)]
    tilt = np.degrees(max(batch.state(i).tilt for i in range(8)))
    print(f"{robot}: {force:.3g} N, {min(speeds):.3f} to {max(speeds):.3f} m/s, tilt {tilt:.1f} deg")
    assert stands
    # A wheel that hardly turns keeps its dry friction, which the law leaves to the deadband.
    np.testing.assert_allclose(speeds, 0.45, rtol=0.02 if params.wheel_coulomb_friction == 0.0 else 0.2)


def _largest(name, params, forces, **options):
    """The largest force at the center of mass, applied at once, that a robot withstands without being carried away."""
    directions = 8
    batch = _batch(params, directions * len(forces))
    for i in range(batch.num_envs):
        angle, size = 2.0 * np.pi * (i % directions) / directions, forces[i // directions]
        batch.apply_force(i, (size * np.cos(angle), size * np.sin(angle), 0.0))
    law, fell = bb.Controller(name, params, **options), np.zeros(batch.num_envs, dtype=bool)
    for _ in range(1200):
        _, _, terminated, _ = batch.step(batch.control(law, setpoints={"position": (0.0, 0.0)}))
        fell |= terminated
    speeds = np.array([np.linalg.norm(batch.state(i).ball_velocity) for i in range(batch.num_envs)])
    stands = (~fell & (speeds < 1.5 * params.scale("m/s"))).reshape(len(forces), directions).all(axis=1)
    return 0.0 if not stands[0] else forces[-1] if stands.all() else forces[np.argmin(stands) - 1]


@pytest.mark.slow("hundreds of robots")
@pytest.mark.parametrize("robot", PRESETS)
def test_following_does_not_topple_it(robot):
    """It withstands at least the forces that the regulator withstands."""
    params = bb.Params.preset(robot)
    step = 0.25 * params.scale("N") * params.scale("rad")
    forces = step * np.arange(1, 41)
    kinds = {
        "lqr": ("lqr", {}),
        "lqr, lean_observer": ("lqr", {"lean_observer": 3.0 * params.scale("1/s")}),
        "admittance": ("admittance", {}),
    }
    found = {title: _largest(name, params, forces, **options) for title, (name, options) in kinds.items()}
    weight = params.gravity * (params.body_mass + params.ball_mass)
    for title, force in found.items():
        print(f"{robot}, {title}: {force:.3g} N, {force / weight:.3f} of the weight")
    assert found["admittance"] >= found["lqr"]
    assert found["admittance"] >= found["lqr, lean_observer"] - 1.01 * step
