"""Controllers that are designed for each robot as events have sampled it: teachers of policies with a history."""

import numpy as np
import pytest

import ballbot_rs as bb

OFFSET = {"term": "body_com_offset", "range": [0.004, 0.005]}


def distances(law, seconds, drawn, setpoints=None, task="balance", **options):
    """Distances of the balls from the origin at the end, m, and whether robots have fallen."""
    options = {"reset_tilt": 0.02, "max_episode_steps": 10_000, **options}
    batch = bb.Batch(9, task, autoreset="disabled", num_threads=1, **options)
    batch.reset()
    for _ in range(round(seconds / batch.control_dt)):
        over = batch.step(batch.control(law, setpoints or {}, privileged=True, drawn=drawn))[2]
        if over.any():
            return np.inf
    return np.linalg.norm(batch.states()[:, :2], axis=1).max()


@pytest.mark.parametrize("model", ["contact", "planar"])
@pytest.mark.parametrize("name", ["lqr", "lqr_pi", "cascade_pid", "mpc"])
def test_without_events_it_is_the_controller(name, model):
    first, second = (bb.Batch(9, model=model, num_threads=1, fall_tilt=0.1) for _ in range(2))
    law = bb.Controller(name)
    np.testing.assert_array_equal(first.reset(), second.reset())
    for _ in range(30):
        actions = first.control(law)
        np.testing.assert_array_equal(second.control(law, drawn=True), actions)
        for batch in (first, second):
            batch.step(actions)


@pytest.mark.parametrize("name", ["lqr", "lqr_pi"])
def test_it_is_the_controller_of_the_sampled_robot(name):
    """A robot of the batch, and a robot with its parameters."""
    batch = bb.Batch(3, events=[OFFSET, {"term": "body_mass", "op": "scale", "range": [0.7, 1.4]}], num_threads=1)
    batch.reset()
    law = bb.Controller(name)
    for _ in range(2):
        own = [bb.Controller(name, batch.params(i), max_torque=batch.max_wheel_torque) for i in range(3)]
        for _ in range(20):
            actions = batch.control(law, {"yaw": 0.3}, drawn=True)
            for i, (state, controller) in enumerate(zip(map(batch.state, range(3)), own, strict=True)):
                limited = np.clip(controller(state, yaw=0.3) / batch.max_wheel_torque, -1.0, 1.0)
                np.testing.assert_allclose(actions[i], limited, atol=2e-6)
            batch.step(actions)
        # The next episode has other robots, and a controller without memory.
        batch.reset()


@pytest.mark.parametrize(
    ("name", "events", "nominal", "drawn"),
    [
        # The CoM: the robot of the design comes to rest elsewhere.
        ("lqr", [OFFSET], 0.05, 2e-3),
        ("lqr", [{"term": "floor_tilt", "range": [0.02, 0.03]}], 0.1, 2e-3),
        ("lqr", [OFFSET, {"term": "floor_tilt", "range": [0.02, 0.03]}], 0.1, 2e-3),
        ("lqr", [{"term": "wheel_viscous_friction", "range": [2e-3, 2e-3]}], 0.0, 2e-3),
    ],
)
def test_it_holds_the_place(name, events, nominal, drawn):
    law = bb.Controller(name)
    without, found = (distances(law, 8.0, messages, events=events) for messages in (False, True))
    assert without > nominal
    assert found < drawn
    assert found < without


def test_it_predicts_over_the_delay_of_the_motors():
    events = [{"term": "actuators.delay", "range": [0.078, 0.08]}]
    assert distances(bb.Lqr(), 6.0, True, events=events) < 5e-3
    assert distances(bb.Lqr(), 6.0, False, events=events) == np.inf
    # A given delay stays.
    assert distances(bb.Lqr(delay=0.01), 6.0, True, events=events) == np.inf
    assert distances(bb.Controller("lqr", delay=0.01), 6.0, True, events=events) == np.inf
    assert distances(bb.Controller("lqr"), 6.0, True, events=events) < 5e-3


def test_it_commands_weak_motors_more_torque():
    events = [{"term": "actuators.strength", "range": [0.6, 1.0]}]
    batch, other = (bb.Batch(2, events=events, seed=1, num_threads=1) for _ in range(2))
    batch.reset(), other.reset()
    law = bb.Controller("lqr", max_torque=0.1)
    strength = np.array([batch.actuators(i)["strength"] for i in range(2)])
    np.testing.assert_allclose(batch.control(law, drawn=True) * strength, other.control(law), atol=1e-6)


def test_every_class_of_controllers_has_a_design():
    batch = bb.Batch(2, control_dt=0.002, events=[OFFSET], num_threads=1)
    batch.reset()
    for law in (bb.Pid(), bb.Lqr(control_dt=0.002), bb.Lqr(control_dt=0.002, Q=np.eye(10), R=np.eye(3))):
        assert np.isfinite(batch.control(law, {}, drawn=True)).all()
        assert not np.array_equal(batch.control(law, {}, drawn=True), batch.control(law, {}))


def test_a_robot_without_a_design_is_named():
    events = [{"term": "max_wheel_torque", "range": [0.1, 0.2]}]
    batch = bb.Batch(2, events=events, num_threads=1, max_wheel_torque=0.25)
    batch.reset()
    with pytest.raises(ValueError, match=r"no design for a sampled robot: max_torque = 0\.25 .* 0\.1"):
        batch.control(bb.Lqr(max_torque=0.25), drawn=True)
