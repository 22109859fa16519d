"""The supervisor as C99: the same in the simulation and in C, and limits that fit the robot."""

import math

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.deployment import controller_header, estimator_header, supervisor_header
from ballbot_rs.deployment.supervised import STATUSES
from ballbot_rs.deployment.supervisor import recoverable
from tests.deployment.test_controllers_in_c import ROBOTS
from tests.support.c_code import READ_STATE, CSupervisor, compiled, pointer, random_states, state_row

PRESETS = bb.Params.preset_names()


def upright(**parts):
    """A state's row, upright at rest except for the given parts."""
    row = np.zeros(17)
    row[0] = 1.0
    for part, value in parts.items():
        row[{"quaternion": slice(0, 4), "rate": slice(4, 7), "wheel_speeds": slice(14, 17)}[part]] = value
    return row


@pytest.mark.parametrize("name", ROBOTS)
def test_supervised_is_the_header_bit_for_bit(name, tmp_path):
    robot, rng = ROBOTS[name], np.random.default_rng(1)
    limits = {"max_speed": 60.0, "heating_time": 0.5, "tilt_time": 0.01}
    in_c = CSupervisor(tmp_path, supervisor_header(robot, **limits))
    wanted = np.zeros(3)
    law = bb.Supervised(lambda _: wanted, robot, **limits)
    statuses = set()
    for i, state in enumerate(random_states(robot, rng, 600)):
        if i % 60 == 0:
            law.reset()
            in_c.reset()
        # Most of them near upright, else it would trip at once.
        near = bb.State.at_equilibrium(robot, tilt=rng.normal(0.0, 0.02, 2)) if i % 60 < 50 else state
        wanted[:] = rng.normal(0.0, robot.max_wheel_torque, 3)
        law.fresh = i % 7 > 0
        status, torques, heat, share = in_c.supervise(state_row(near), wanted if law.fresh else np.zeros(3), law.fresh)
        np.testing.assert_array_equal(law(near, bb.Setpoint()), torques)
        assert law.status == STATUSES[status]
        np.testing.assert_array_equal([*law.heat, law.share], [*heat, share])
        statuses.add(law.status)
    assert statuses >= {"running", "torque", "heat", "held", "tilt"}


@pytest.mark.parametrize("real", ["double", "float"])
def test_statuses_of_faults(real, tmp_path):
    robot = bb.Params.preset("kugle")
    tilt, rate, toppling = recoverable(robot, robot.max_wheel_torque)
    in_c = CSupervisor(tmp_path, supervisor_header(robot, actuators="kugle", tilt_time=0.0), real)
    torques = [0.1, -0.2, 0.3]

    def status_of(row, torques=torques, fresh=True):
        return STATUSES[in_c.supervise(row, torques, fresh)[0]]

    def leaning(angle):
        return upright(quaternion=[math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])

    def turning(speed, yaw_rate=0.0):
        return upright(rate=[0.0, speed, yaw_rate])

    inside = [leaning(0.99 * tilt), turning(0.99 * rate, 5.0), upright(wheel_speeds=[134.0, -134.0, 0.0])]
    # Where it leans to one side and returns, it can lean more.
    inside += [leaning(1.5 * tilt) + turning(-0.6 * rate) - upright()]
    for row in inside:
        assert status_of(row) == "running"
    for row, expected in [
        (leaning(1.01 * tilt), "tilt"),
        (turning(-1.01 * rate), "tilt"),
        (leaning(0.6 * tilt) + turning(0.6 * rate) - upright(), "tilt"),
        (upright(quaternion=[0.0, 1.0, 0.0, 0.0]), "tilt"),
        (upright(wheel_speeds=[0.0, -135.0, 0.0]), "speed"),
    ]:
        in_c.reset()
        assert status_of(row) == expected
        # It stays so, and the torques fall linearly to zero within the time constant of toppling.
        steps = math.ceil(100.0 / toppling)
        answers = [in_c.supervise(upright(), torques) for _ in range(steps)]
        assert all(STATUSES[answer[0]] == expected for answer in answers)
        shares = [answer[1][2] / 0.3 for answer in answers]
        np.testing.assert_allclose(shares, np.maximum(1.0 - 0.01 * toppling * np.arange(2, steps + 2), 0.0), atol=1e-5)
        assert not answers[-1][1].any()


def test_only_a_tilt_that_lasts_trips(tmp_path):
    """Half of the time constant of toppling, 8 steps."""
    in_c = CSupervisor(tmp_path, supervisor_header("paper"))
    beyond = upright(rate=[0.0, 3.0, 0.0])
    for count, last in ((7, "running"), (8, "tilt")):
        in_c.supervise(upright(), np.zeros(3))
        statuses = [STATUSES[in_c.supervise(beyond, np.zeros(3))[0]] for _ in range(count)]
        assert statuses == ["running"] * 7 + [last] * (count - 7)


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("fault", ["stale", "not_finite", "no attitude", "half an attitude"])
def test_missing_readings_are_bridged_and_then_trip(fault, real, tmp_path):
    in_c = CSupervisor(tmp_path, supervisor_header("paper", most_missed=2, ramp_time=0.05), real)
    assert in_c.supervise(upright(), [0.1, 0.2, 0.3])[0] == STATUSES.index("running")
    bad = {
        "stale": (upright(), [9.0] * 3, False),
        "not_finite": (upright(rate=math.nan), [9.0] * 3, True),
        # As a driver leaves a quaternion that has not begun, and a quaternion that is not normalized.
        "no attitude": (upright(quaternion=[0.0] * 4), [9.0] * 3, True),
        "half an attitude": (upright(quaternion=[0.5, 0.5, 0.0, 0.0]), [9.0] * 3, True),
    }[fault]
    fault = "stale" if fault == "stale" else "not_finite"
    found = [in_c.supervise(*bad) for _ in range(8)]
    assert [STATUSES[answer[0]] for answer in found] == ["held"] * 2 + [fault] * 6
    expected = np.outer([1.0, 1.0, 0.8, 0.6, 0.4, 0.2, 0.0, 0.0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose([answer[1] for answer in found], expected, atol=1e-7)
    # Readings that return do not end a trip.
    assert STATUSES[in_c.supervise(upright(), [0.1] * 3)[0]] == fault


def test_a_memory_of_zeros_gives_no_torque(tmp_path):
    source = (
        f'#include "{tmp_path / "supervisor.h"}"\n'
        + """
        int first(double *torques);
        int first(double *torques)
        {
            ballbot_supervisor supervisor = {{0}, {0}, 0, 0, 0, 0};
            ballbot_state state = {{1, 0, 0, 0}, {0}, {0}, {0}, {0}, {0}};
            return ballbot_supervise(&supervisor, &state, 1, torques);
        }
        """
    )
    (tmp_path / "supervisor.h").write_text(supervisor_header(), encoding="ascii")
    torques = np.ones(3)
    assert STATUSES[compiled(tmp_path, source).first(pointer(torques))] == "off"
    assert not torques.any()


def test_the_heat_of_a_motor_is_a_lag_and_stays_within_its_limit(tmp_path):
    rest, time = 0.5, 2.0
    limits = {"max_torque": 4.0, "continuous_torque": rest, "heating_time": time}
    in_c = CSupervisor(tmp_path, supervisor_header("paper", **limits))
    answers = [in_c.supervise(upright(), [0.0, -1.5, 0.3]) for _ in range(1000)]
    heat, torques = np.array([answer[2] for answer in answers]), np.array([answer[1] for answer in answers])
    statuses = [STATUSES[answer[0]] for answer in answers]
    first = statuses.index("heat")
    # 1 = 9 (1 - exp(-t / T))
    assert first * 0.01 == pytest.approx(-time * math.log(1.0 - 1.0 / 9.0), abs=0.02)
    assert set(statuses[:first]) == {"running"}
    assert set(statuses[first:]) == {"heat"}
    assert heat.max() <= 1.0 + 1e-12
    # Then it has its continuous torque, and the others less with it.
    np.testing.assert_allclose(torques[-1], [0.0, -rest, 0.1], atol=1e-9)
    cooling = [in_c.supervise(upright(), np.zeros(3))[2][1] for _ in range(200)]
    assert cooling[-1] == pytest.approx(math.exp(-1.0), rel=0.01)


def test_it_is_in_one_file_with_a_controller_and_an_estimator(tmp_path):
    texts = {
        "controller": controller_header("lqr", "kugle"),
        "estimator": estimator_header("kugle", "kugle"),
        "supervisor": supervisor_header("kugle"),
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.h").write_text(text, encoding="ascii")
    includes = "".join(f'#include "{tmp_path / name}.h"\n' for name in texts)
    uses = "int all(ballbot_supervisor *s, const ballbot_state *state, ballbot_real torques[3]);\n"
    uses += "int all(ballbot_supervisor *s, const ballbot_state *state, ballbot_real torques[3])\n"
    uses += "{\n    return ballbot_supervise(s, state, 1, torques);\n}\n"
    compiled(
        tmp_path,
        includes + READ_STATE + uses + "void read(void);\nvoid read(void)\n{\n    (void)read_state;\n}\n",
        ["-Wno-unused-function"],
    )


def recovers(robot, tilt, rate):
    """Whether a robot that rolls with this tilt and tilt rate returns to upright under `lqr`."""
    start = bb.State.at_equilibrium(robot, tilt=tilt)
    simulated, law = bb.Ballbot(robot), bb.Lqr(robot)
    try:
        simulated.reset(bb.State.rolling(robot, (0.0, 0.0), start.body_quaternion, (*rate, 0.0), 0.0))
    except bb.InvalidInputError:
        # A wheel would be below the floor.
        return False
    for _ in range(round(10.0 * robot.scale("s") / law.control_dt)):
        simulated.step(law(simulated.state), round(law.control_dt / 0.001))
        if simulated.contacts.bot_on_floor or simulated.state.tilt > 1.2:
            return False
    return simulated.state.tilt < 0.1


def recovering(name, factor):
    """Fraction of the states at `factor` times the limit that recover (12 azimuths)."""
    robot = bb.Params.preset(name)
    tilt, rate, _ = recoverable(robot, robot.max_wheel_torque)
    found = [
        recovers(robot, factor * (1.0 - part) * tilt * axis, factor * part * rate * axis)
        for part in (0.0, 0.5, 1.0)
        for axis in (np.array([math.cos(a), math.sin(a)]) for a in np.arange(12) * math.pi / 6)
    ]
    return float(np.mean(found))


@pytest.mark.slow("hundreds of simulations")
@pytest.mark.parametrize("name", PRESETS)
def test_the_basin_is_what_the_simulation_recovers_from(name):
    robot = bb.Params.preset(name)
    tilt, rate, _ = recoverable(robot, robot.max_wheel_torque)
    found = {factor: recovering(name, factor) for factor in (0.9, 1.0, 1.1, 1.2, 1.3, 1.5)}
    print(f"{name}: {math.degrees(tilt):.1f}°, {math.degrees(rate):.0f}°/s;", found)
    assert found[0.9] == 1.0
    assert found[1.3] < 0.5
    assert found[1.5] == 0.0


def test_the_command_writes_the_header(tmp_path, capsys):
    target = tmp_path / "supervisor.h"
    given = ["--robot", "kugle", "--actuators", "kugle", "--set", "control_dt=0.005", "--limit", "ramp_time=0.1"]
    assert main(["export", "--supervisor", *given, "-o", str(target)]) == 0
    assert target.read_text(encoding="ascii") == supervisor_header("kugle", 0.005, actuators="kugle", ramp_time=0.1)
    capsys.readouterr()


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ({"max_torque": 0.0}, "max_torque = 0.0 is out of range"),
        ({"max_speed": math.nan}, "max_speed = nan is out of range"),
        ({"continuous_torque": -1.0}, "continuous_torque = -1.0 is out of range"),
        ({"heating_time": 0.001}, "heating_time = 0.001 is out of range: expected 0.01 to 1e\\+09"),
        ({"ramp_time": 0.0}, "ramp_time = 0.0 is out of range"),
        ({"most_missed": 2.5}, "most_missed = 2.5: expected a whole number"),
        ({"basin": 1.5}, "basin = 1.5 is out of range: expected 0.01 to 1"),
        ({"tilt_time": -1.0}, "tilt_time = -1.0 is out of range"),
        ({"control_dt": "fast"}, "control_dt = 'fast' is not a number"),
        ({"actuators": {"no_load_sped": 30.0}}, "actuators has an unknown option 'no_load_sped'"),
        ({"actuators": {"no_load_sped": 30.0}, "max_speed": 50.0}, "actuators has an unknown option 'no_load_sped'"),
        ({"max_speed": "fast"}, "max_speed = 'fast' is not a number"),
        ({"actuators": {"speed_limit": -30.0}}, "actuators.speed_limit = -30.0 is out of range"),
        ({"actuators": {"speed_limit": math.nan}}, "actuators.speed_limit = nan is out of range"),
    ],
)
def test_limits_out_of_range_are_rejected(limit, message):
    with pytest.raises(ValueError, match=message):
        supervisor_header("paper", **limit)


@pytest.mark.parametrize("header", [supervisor_header, lambda robot: estimator_header(robot, "exact")])
@pytest.mark.parametrize(
    ("robot", "message"),
    [("", "unknown robot preset ''"), ("kugel", "unknown robot preset 'kugel'"), (3, "not int")],
)
def test_robots_that_are_none_are_rejected(header, robot, message):
    with pytest.raises((ValueError, TypeError), match=message):
        header(robot)
