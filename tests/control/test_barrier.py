"""Control barriers of the laws: limits of the speed and a boundary, kept without a fall."""

import math

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.deployment.supervisor import recoverable

PRESETS = bb.Params.preset_names()
#: Laws that follow positions and velocities in Rust, but planners, whose steps take milliseconds.
LAWS = [name for name, info in bb.controllers().items() if name not in ("pid", "mppi", "nmpc")]
EPISODES = 12
STEPS = 200


def limits_of(robot):
    """A speed limit and a boundary of the size of a robot, m/s and m."""
    params = bb.Params.preset(robot)
    speed, length = 0.5 * params.scale("m/s"), params.scale("m")
    return params, speed, [-0.8 * length, 1.0 * length, -0.6 * length, 0.6 * length]


def batch_of(params, **options):
    options = {"num_envs": EPISODES, "num_threads": 1, "max_wheel_torque": params.max_wheel_torque} | options
    return bb.Batch(robot=params, max_episode_steps=100_000, **options)


def driven(law, params, commands, steps=STEPS, impulses=None, **options):
    """States of robots under commands, mappings of parts that last `steps` control steps; and which robots fell."""
    batch = batch_of(params, control_dt=law.control_dt, **options)
    batch.reset(starts=[bb.State.at_equilibrium(params)] * EPISODES)
    states, fell = [], np.zeros(EPISODES, dtype=bool)
    for command in commands:
        found = batch.rollout(law, steps, command, ("states", "terminated"), impulses=impulses)
        impulses = None
        states.append(found["states"][:-1])
        fell |= found["terminated"].any(axis=0)
    return np.concatenate(states), fell


def commands_of(kind, params, speed, boundary, seed):
    """Random commands beyond the limits."""
    rng = np.random.default_rng(seed)
    half = np.array([boundary[1], boundary[3]])
    for _ in range(5):
        position = rng.uniform(-3.0, 3.0, (EPISODES, 2)) * half
        velocity = rng.uniform(-4.0, 4.0, (EPISODES, 2)) * speed
        yaw_rate = rng.uniform(-1.0, 1.0, EPISODES)
        if kind == "position":
            yield {"position": position}
        elif kind == "velocity":
            # The position follows the ball, as with a joystick.
            yield {"velocity": velocity}
        else:
            acceleration = 0.1 * params.scale("m/s²") * rng.uniform(-3.0, 3.0, (EPISODES, 2))
            yield {"position": position, "velocity": velocity, "acceleration": acceleration, "yaw_rate": yaw_rate}


def excess(states, speed, boundary):
    """Largest speed over its limit, and largest distance beyond the boundary, m."""
    x, y = states[..., 0], states[..., 1]
    beyond = np.stack([boundary[0] - x, x - boundary[1], boundary[2] - y, y - boundary[3]])
    speeds = np.hypot(states[..., 7], states[..., 8])
    return float(speeds.max()) / speed, float(beyond.max())


def with_limits(name, robot, **options):
    params, speed, boundary = limits_of(robot)
    return bb.Controller(name, params, speed_limit=speed, boundary=boundary, **options)


@pytest.mark.slow  # Every law drives 12 robots for 10 s under three kinds of commands.
@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize("kind", ["velocity", "position", "motion"])
def test_limits_hold_under_any_command(robot, kind):
    params, speed, boundary = limits_of(robot)
    worst = {"mpc": [0.0, -math.inf], "others": [0.0, -math.inf]}
    for name in LAWS:
        law = with_limits(name, robot)
        states, fell = driven(law, params, commands_of(kind, params, speed, boundary, 1))
        assert not fell.any(), name
        group = worst["mpc" if name == "mpc" else "others"]
        group[:] = np.maximum(group, excess(states, speed, boundary)).tolist()
    for group, (faster, farther) in worst.items():
        print(f"barrier: {robot}, {kind}, {group}: {faster:.3f} of the speed limit, {-farther:.3f} m from the boundary")
        # Where the torques of the law are at the traction limit, the barrier commands more than the wheels transmit.
        assert faster < (1.1 if group == "mpc" else 1.04)
        # The joints of asroballet have dry friction, which the linear model has not.
        assert farther < (0.05 if robot == "asroballet" else 0.0)


@pytest.mark.parametrize("robot", PRESETS)
@pytest.mark.parametrize("fraction", [0.3, 1.0])
def test_a_far_setpoint_does_not_speed_the_ball_up_for_a_minute(robot, fraction):
    """With one bound for all tests a ball that was once faster than the limit crept to six times as much."""
    params, speed, _ = limits_of(robot)
    law = bb.Controller("lqr", params, speed_limit=fraction * speed)
    far = (60.0 * params.scale("m"), 20.0 * params.scale("m"))
    motion = bb.simulate(law, robot=params, reference={"position": far}, seconds=60.0).to_array()
    assert np.hypot(motion[:, 7], motion[:, 8]).max() < 1.02 * fraction * speed


def test_the_same_commands_without_a_barrier_break_the_limits():
    params, speed, boundary = limits_of("paper")
    states, _ = driven(bb.Controller("lqr", params), params, commands_of("position", params, speed, boundary, 1))
    faster, farther = excess(states, speed, boundary)
    assert faster > 1.5
    assert farther > 0.1


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("robot", PRESETS)
def test_far_from_the_limits_no_bit_changes(name, robot):
    params = bb.Params.preset(robot)
    far = {"speed_limit": 100.0, "boundary": (-1e3, 1e3, -1e3, 1e3)}
    rng = np.random.default_rng(3)
    free, limited = bb.Controller(name, params), bb.Controller(name, params, **far)
    for _ in range(20):
        tilt = rng.uniform(-0.1, 0.1, 2) * params.scale("rad")
        state = bb.State.at_equilibrium(params, tilt, float(rng.uniform(-3.0, 3.0)))
        position = rng.uniform(-0.5, 0.5, 2)
        assert np.array_equal(free(state, position=position), limited(state, position=position))


def test_a_robot_and_eight_robots_have_the_same_torques():
    params, speed, boundary = limits_of("kugle")
    commands = list(commands_of("position", params, speed, boundary, 5))
    law = with_limits("lqr", "kugle")
    batch = batch_of(params)
    batch.reset()
    batch.rollout(law, 150, commands[0], ())
    states = [bb.State.from_array(row) for row in batch.states()]
    found = batch.control(law, commands[1]) * params.max_wheel_torque
    expected = [law(state, position=place) for state, place in zip(states, commands[1]["position"], strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * params.max_wheel_torque)


@pytest.mark.parametrize("robot", PRESETS)
def test_a_push_beyond_the_barrier_is_survived_and_the_ball_returns(robot):
    """A push towards the boundary from a place near it."""
    params, _, boundary = limits_of(robot)
    place = {"position": (0.95 * boundary[1], 0.0)}
    impulses = np.zeros((1, EPISODES, 3))
    impulses[0, :, 0] = 0.15 * (params.body_mass + params.ball_mass) * params.scale("m/s")
    for name in ("lqr", "cascade_pid"):
        for law in (bb.Controller(name, params), with_limits(name, robot)):
            batch = batch_of(params)
            batch.reset(starts=[bb.State.at_equilibrium(params)] * EPISODES)
            batch.rollout(law, 1500, place, ())
            found = batch.rollout(law, 1500, place, ("states", "terminated"), impulses=impulses)
            assert not found["terminated"].any(), name
        x = found["states"][:, :, 0]
        assert x.max() > boundary[1], name
        assert x[-1].max() < boundary[1], name


@pytest.mark.parametrize("robot", PRESETS)
def test_tilts_that_a_law_recovers_from_are_recovered_from_with_a_barrier(robot):
    params = bb.Params.preset(robot)
    # The task ends at a tilt of 20°.
    tilt = min(0.8 * recoverable(params, params.max_wheel_torque)[0], math.radians(18.0))
    angles = np.linspace(0.0, 2.0 * math.pi, EPISODES, endpoint=False)
    starts = [bb.State.at_equilibrium(params, (tilt * math.cos(a), tilt * math.sin(a))) for a in angles]
    for law in (bb.Controller("lqr", params), with_limits("lqr", robot)):
        batch = batch_of(params)
        batch.reset(starts=starts)
        assert not batch.rollout(law, 300, {"position": (0.0, 0.0)}, ("terminated",))["terminated"].any()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"speed_limit": math.nan}, "speed_limit"),
        ({"speed_limit": 0.0}, "speed_limit"),
        ({"speed_limit": -1.0}, "speed_limit"),
        ({"boundary": (-1.0, 1.0, -1.0, math.nan)}, "boundary"),
        ({"boundary": (-1.0, 1.0, -math.inf, 1.0)}, "boundary"),
        ({"boundary": (1.0, -1.0, -1.0, 1.0)}, "from x = 1 m to -1 m"),
        ({"boundary": (-1.0, 1.0, 0.0, 0.01)}, "from y = 0 m to 0.01 m"),
        ({"boundary": (-1.0, 1.0)}, "boundary"),
    ],
)
def test_limits_that_make_no_sense_are_rejected(options, reason):
    with pytest.raises(ValueError, match=reason):
        bb.Controller("lqr", "paper", **options)
