"""The ride task: a rider who drives by leaning, the seat, braking."""

from itertools import pairwise

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from tests.support.paths import ROOT

NAMES = [metric["name"] for metric in TASKS["ride"]["metrics"]]
ROWS = [row["name"] for row in TASKS["ride"]["observation"]]
#: A robot of 60 kg to ride.
SEAT = ROOT / "validation" / "policies" / "own_robots" / "ride.toml"
ROBOTS = [*bb.Params.preset_names(), str(SEAT)]


def new(robots=4, **options):
    return bb.Batch(robots, "ride", **{"seed": 3, "autoreset": "disabled", "num_threads": 1, **options})


def ridden(batch, steps, law="lqr"):
    """Commands, states, setpoints and offsets of the seats at each control step."""
    controller = bb.Controller(law, batch.params(0), batch.control_dt)
    batch.reset()
    found = []
    for _ in range(steps):
        setpoints = [batch.setpoint(i) for i in range(batch.num_envs)]
        found.append((batch.command(), batch.states(), setpoints, batch.payloads()))
        batch.step(batch.control(controller))
    return found


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.rpartition("/")[2])
@pytest.mark.parametrize("law", ["lqr", "cascade_pid"])
def test_laws_carry_riders_who_start_and_stop(robot, law):
    found = bb.evaluate(law, task="ride", episodes=32, robot=robot)
    assert found.success_rate >= 0.95


def test_the_robot_to_ride_stops_from_the_published_speed():
    """PURE (arXiv 2409.18452) brakes from 1.4 m/s."""
    params = bb.Params.from_toml(SEAT)
    assert new(robot=params).options["speed"] == pytest.approx(1.4, abs=0.01)
    found = bb.evaluate("lqr_pi", task="ride", episodes=32, robot=params).metrics
    assert 1.4 <= found["top_speed"] < 1.75
    # Nobody who brakes at the commanded acceleration is faster.
    assert 0.5 * 1.4**2 / 0.9 < found["braking_distance"] < 2.5
    assert 1.4 / 0.9 < found["braking_time"] < 3.5


def test_a_rider_is_a_part_of_the_body_and_a_payload_is_the_rider():
    paper = bb.Params.paper()
    ridden = new(robot=paper).params(0)
    assert ridden.payload_mass == 0.35 * paper.body_mass
    assert ridden.body_mass == paper.body_mass
    assert ridden.with_payloads_fixed() == paper.replace(
        **{name: getattr(ridden, name) for name in ("payload_position", "payload_stiffness", "payload_damping")}
    )
    own = paper.with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=100.0, damping=5.0)
    assert new(robot=own).params(0) == own


def test_riders_want_to_go_and_to_stop_in_turn_and_in_all_directions():
    batch = new(64, cruise_seconds=(0.2, 0.4), stop_seconds=(0.1, 0.3))
    commands = np.array([command for command, *_ in ridden(batch, 200)])
    speeds = np.linalg.norm(commands[:, :, :2], axis=2)
    speed = batch.options["speed"]
    assert set(np.round(np.unique(speeds), 9)) == {0.0, round(speed, 9)}
    assert (speeds[0] > 0.0).all()
    directions = np.arctan2(commands[0, :, 1], commands[0, :, 0])
    assert np.abs(np.exp(1j * directions).mean()) < 0.3
    for robot in speeds.T:
        changes = np.flatnonzero(np.diff(robot > 0.0)) + 1
        lengths = np.diff([0, *changes])
        assert (lengths[0::2] >= 20).all()
        assert (lengths[0::2] <= 40).all()
        assert (lengths[1::2] >= 10).all()
        assert (lengths[1::2] <= 30).all()


def test_seeds_repeat_a_ride_to_the_last_bit():
    first, again = (ridden(new(3, seed=5), 300) for _ in range(2))
    other = ridden(new(3, seed=8), 300)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a[1], b[1])
        np.testing.assert_array_equal(a[3], b[3])
    assert (first[0][0] != other[0][0]).any()


@pytest.mark.parametrize("robot", ["paper", str(SEAT)], ids=["paper", "ride"])
def test_riders_lean_towards_what_they_want_with_a_lag(robot):
    """A robot without a task, whose payload is moved as the rider should, moves as the robot of the task."""
    batch = new(1, robot=robot)
    options, dt = batch.options, batch.control_dt
    params = batch.params(0)
    length = np.linalg.norm(params.payload_position)
    copy = bb.Batch(
        1, "bare", robot=params, num_threads=1, autoreset="disabled", max_wheel_torque=batch.max_wheel_torque
    )
    start = bb.State.at_rest(params, tilt=(0.02, -0.01), yaw=0.4)
    copy.reset(starts=[start])
    batch.reset(starts=[start])
    controller = bb.Controller("lqr", params, dt)
    wish, lean = batch.command()[0, :2], np.zeros(2)
    for _ in range(100):
        copy.move_payload(0, (*(length * lean), 0.0))
        action = batch.control(controller)
        batch.step(action)
        copy.step(action)
        np.testing.assert_allclose(copy.states(), batch.states(), atol=1e-9)
        np.testing.assert_allclose(copy.payloads(), batch.payloads(), atol=1e-9)
        state = batch.state(0)
        cos, sin = np.cos(state.yaw), np.sin(state.yaw)
        vx, vy, _ = state.ball_velocity
        target = options["lean"] / options["eagerness"] * (wish - [cos * vx + sin * vy, cos * vy - sin * vx])
        target *= min(1.0, options["lean"] / np.linalg.norm(target))
        lean += (target - lean) * (1.0 - np.exp(-dt / options["reaction"]))
    assert np.linalg.norm(lean) > 0.3 * options["lean"]


def test_the_seat_measures_the_lean_and_commands_a_smooth_motion():
    batch = new(2, scale_observations=False)
    most, dt = batch.options["acceleration"], batch.control_dt
    lean = [ROWS.index(f"lean of the rider, body {axis}") for axis in "xy"]
    length = np.linalg.norm(batch.params(0).payload_position)
    controller = bb.Controller("lqr", batch.params(0), dt)
    batch.reset()
    before = batch.setpoint(0)
    for _ in range(400):
        observations = batch.step(batch.control(controller))[0]
        np.testing.assert_allclose(observations[:, lean], batch.payloads()[:, 0, :2] / length, rtol=1e-6, atol=1e-7)
        setpoint = batch.setpoint(0)
        for part, rate in pairwise(("position", "velocity", "acceleration", "jerk")):
            change = np.subtract(setpoint[part], before[part]) / dt
            np.testing.assert_allclose(change, setpoint[rate], atol=1e-9)
        assert np.linalg.norm(setpoint["acceleration"]) <= most * (1.0 + 1e-9)
        before = setpoint
    assert np.linalg.norm(setpoint["velocity"]) > 0.5 * batch.options["speed"]


def test_braking_is_measured_from_the_wish_to_stop():
    batch = new(6, cruise_seconds=(6.0, 8.0), stop_seconds=(8.0, 8.0), max_episode_steps=1700)
    found = ridden(batch, 1650)
    limit, dt = batch.options["stopped_speed"], batch.control_dt
    hold = round(batch.options["stopped_seconds"] / dt)
    metrics = batch.metrics()
    for i in range(6):
        commands = np.array([command[i] for command, *_ in found])
        states = np.array([states[i] for _, states, *_ in found])
        begin = int(np.flatnonzero((commands[1:, :2] == 0.0).all(1) & (commands[:-1, :2] != 0.0).any(1))[0]) + 1
        balls = np.array([bb.State.from_array(row).ball_position[:2] for row in states])
        speeds = np.array([np.linalg.norm(bb.State.from_array(row).ball_velocity[:2]) for row in states])
        slow = next(k for k in range(begin, 1650) if (speeds[k : k + hold] <= limit).all())
        distance = np.linalg.norm(balls[begin : slow + hold] - balls[begin], axis=1).max()
        assert metrics[i, NAMES.index("stops")] == 1
        assert metrics[i, NAMES.index("braking_time")] == pytest.approx((slow - begin) * dt, abs=2.5 * dt)
        assert metrics[i, NAMES.index("braking_distance")] == pytest.approx(distance, abs=0.01)
        assert metrics[i, NAMES.index("top_speed")] == pytest.approx(speeds.max(), rel=1e-6)


def test_a_timid_robot_needs_more_room():
    far, near = (
        bb.evaluate("lqr", task="ride", episodes=16, robot=str(SEAT), acceleration=acceleration).metrics
        for acceleration in (0.6, 0.9)
    )
    assert far["braking_distance"] > 1.1 * near["braking_distance"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lean": float("nan")}, "lean"),
        ({"rider_mass": 0.95}, "rider_mass"),
        ({"rider_mass": 0.9}, "payload_mass = 2.0"),
        ({"rider_mass": 0.7, "rider_height": 1.0}, "moment of inertia of the body without payload_mass"),
        ({"rider_frequency": 1000.0}, "payload_stiffness"),
        ({"cruise_seconds": (2.0, 1.0)}, "cruise_seconds"),
        ({"model": "planar"}, "payload_mass"),
    ],
)
def test_invalid_riders_are_named(options, message):
    with pytest.raises((ValueError, TypeError), match=message):
        new(**options)


def test_a_robot_without_a_rider_is_rejected():
    batch = new(1)
    with pytest.raises(ValueError, match="payload_mass = 0"):
        batch.set_params(0, bb.Params.paper())


def test_another_engine_moves_no_rider():
    batch = new(1)
    batch.reset()
    with pytest.raises(ValueError, match="riders lean"):
        batch.step_with(np.zeros((1, 3), np.float32), lambda states, _: states)
