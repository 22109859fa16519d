import contextlib
import copy
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.resolve import find
from ballbot_rs.link.frames import Frame, encode
from ballbot_rs.link.layout import Flag, Kind, Status
from tests.support.commands import IMPORT_PATH
from tests.support.links import Board, Damping, free_address, peer_command, pty_pair, same, serving
from tests.support.paths import ASSETS

#: Noise, a delay of the motors and a moving setpoint: all of it is in the simulation.
SCENE = {"sensors": "kugle", "actuators": {"delay": 0.004, "lag": 0.01}, "tilt": (0.05, -0.02), "seconds": 0.3}
TARGET = {"reference": {"position": (0.01, 0.0)}}


#: Numbers in the order of a frame.
SETPOINT = {"position": (1.0, 2.0), "velocity": (3.0, 4.0), "yaw": 5.0, "yaw_rate": 6.0}
SETPOINT |= {"acceleration": (7.0, 8.0), "jerk": (9.0, 10.0), "snap": (11.0, 12.0)}


def in_process():
    return bb.simulate(Damping(), **SCENE, **TARGET)


def test_child_process_gives_the_states_of_the_process_bit_for_bit(tmp_path):
    with bb.Link(f"exec:{peer_command(tmp_path)} stdio:") as link:
        assert same(bb.simulate(link, **SCENE, **TARGET), in_process())
    assert link.statistics.answered == 30


def test_udp_gives_the_states_of_the_process_bit_for_bit():
    address = free_address()
    with serving(Damping(), address), bb.Link(address) as link:
        assert same(bb.simulate(link, **SCENE, **TARGET), in_process())


def test_serial_port_gives_the_states_of_the_process_bit_for_bit():
    with pty_pair() as (ours, theirs), serving(Damping(), theirs), bb.Link(f"{ours}?baud=921600") as link:
        assert same(bb.simulate(link, **SCENE, **TARGET), in_process())


def test_address_names_a_controller_everywhere():
    address = free_address()
    with serving(Damping(), address):
        assert same(bb.simulate(address, **SCENE, **TARGET), in_process())


def test_episodes_begin_with_reset_and_time_zero():
    law, address = Damping(), free_address()
    with serving(law, address), bb.Link(address) as link:
        first = bb.simulate(link, **SCENE, **TARGET)
        again = bb.simulate(link, **SCENE, **TARGET)
    assert same(first, again)
    # A repetition, on a slow machine, is not a call.
    assert law.calls == link.statistics.answered == 60


def test_readings_carry_flags_clock_and_setpoint():
    seen = []

    def answer(frame):
        seen.append(frame)
        return [encode(Frame(Kind.TORQUES, 0, frame.sequence, frame.time, (0.0, 0.0, 0.0)))]

    board = Board()
    with board.answering(answer), bb.Link(board.address) as link:
        motion = bb.simulate(
            link,
            seconds=0.05,
            reference=SETPOINT,
            control_dt=0.004,
        )
    assert [frame.flags for frame in seen] == [Flag.RESET] + [0] * (len(seen) - 1)
    assert [frame.time for frame in seen] == [4000 * i for i in range(len(seen))]
    steps = np.diff([frame.sequence for frame in seen]) % 2**32
    assert (steps == 1).all()
    assert seen[0].numbers[9:] == tuple(map(float, range(1, 13)))
    # Exact sensors at rest: gravity as the accelerometer reads it.
    assert seen[0].numbers[:6] == pytest.approx((0, 0, 0, 0, 0, motion.params.gravity), abs=1e-12)


def test_evaluate_runs_one_episode_and_rejects_more():
    address = free_address()
    with serving(Damping(), address), bb.Link(address) as link:
        assert bb.evaluate(link, episodes=1).episodes == 1
        with pytest.raises(TypeError, match="link cannot be copied for 2 robots: a link drives one robot"):
            bb.evaluate(link, episodes=2)


def answered_with(torques, flags=0):
    board = Board()
    return board, board.answering(
        lambda frame: [encode(Frame(Kind.TORQUES, flags, frame.sequence, frame.time, torques))]
    )


def test_torques_beyond_the_limit_are_scaled_as_of_any_law():
    board, answering = answered_with((10.0, -20.0, 5.0))
    with answering, bb.Link(board.address) as link:
        motion = bb.simulate(link, seconds=0.03)
    limit = motion.params.max_wheel_torque
    assert motion.torques[0] == pytest.approx(limit * np.array([0.5, -1.0, 0.25]))


def test_torques_that_are_not_finite_end_the_run():
    board, answering = answered_with((0.0, float("nan"), 0.0))
    with (
        answering,
        bb.Link(board.address) as link,
        pytest.raises(bb.InvalidInputError, match=r"link gave the torques .*nan"),
    ):
        bb.simulate(link, seconds=0.03)


def test_status_of_the_controller_is_counted():
    board, answering = answered_with((0.0, 0.0, 0.0), Status.LIMIT)
    with answering, bb.Link(board.address) as link:
        bb.simulate(link, seconds=0.03)
    assert link.statistics.statuses == {"limit": 3}


def test_law_that_reads_sensors_needs_sensors():
    with pytest.raises(bb.InvalidInputError, match="damping reads sensors, and the robots have none"):
        bb.simulate(Damping(), seconds=0.1)


@pytest.mark.parametrize("batched", [False, True])
def test_law_in_the_process_reads_sensors(batched):
    class Reader:
        reads_sensors = True

        def __call__(self, readings):
            return -0.01 * readings["gyro"]

    Reader.batched = batched
    law = Reader()
    motion = bb.simulate(law, sensors="exact", tilt=(0.05, 0.0), seconds=0.1)
    assert motion.torques[3] == pytest.approx(-0.01 * motion.states[3].body_angular_velocity, abs=1e-7)


@pytest.mark.parametrize("name", ["lqr", "cascade_pid", "lqr_pi"])
@pytest.mark.parametrize("robot", ["paper", "kugle"])
def test_a_linked_robot_is_the_robot_that_observes_sensors_bit_for_bit(robot, name):
    """On a circle, through a push, from rest, whose readings ticks and latency do not change."""
    sensors, address = {"encoder_ticks": 4096.0, "latency": 0.01}, free_address()
    scene = {"robot": robot, "sensors": sensors, "seconds": 3.0, "reference": bb.Reference.circle(0.2, 5.0)}
    scene["pushes"] = [bb.Push((0.1, 0.05, 0.0), time=1.0)]
    with serving(bb.EstimatedController(name, robot, sensors), address), bb.Link(address) as link:
        linked = bb.simulate(link, **scene)
    ours = bb.simulate(name, observation="sensors", **scene)
    assert same(linked, ours)
    assert np.linalg.norm(ours.states[-1].ball_velocity) > 0.1


def test_estimated_controller_begins_in_the_attitude_of_the_accelerometer():
    tilted = bb.simulate(bb.EstimatedController("lqr"), sensors="exact", seconds=1.0, tilt=(0.08, 0.05))
    assert tilted.fell_at is None
    assert tilted.states[-1].tilt < 0.02


def test_estimated_controller_over_a_link_is_the_same_bit_for_bit():
    address = free_address()
    scene = {**SCENE, "seconds": 0.5}
    with serving(bb.EstimatedController("lqr", sensors="kugle"), address), bb.Link(address) as link:
        assert same(bb.simulate(link, **scene), bb.simulate(bb.EstimatedController("lqr", sensors="kugle"), **scene))


def test_a_supervised_controller_answers_with_its_trip():
    """It begins beyond what it recovers from: its status is in the statistics, its torques fall to zero."""
    address, law = free_address(), bb.EstimatedController("lqr", sensors="kugle")
    scene = {"sensors": "kugle", "tilt": (0.6, 0.0), "seconds": 0.3, "fall_tilt": 1.5}
    with serving(bb.Supervised(law, tilt_time=0.05), address), bb.Link(address) as link:
        motion = bb.simulate(link, **scene)
    assert link.statistics.statuses["running"] == 4
    assert link.statistics.statuses["limit"] >= 10
    largest = np.abs(motion.torques).max(axis=1)
    assert largest[3] > largest[10] > 0.0
    assert not largest[4 + 17 :].any()


def test_estimated_controller_rejects_another_period():
    law = bb.EstimatedController("lqr", control_dt=0.01)
    with pytest.raises(bb.InvalidInputError, match=r"lqr is made for control_dt = 0\.01 s, .* every 0\.02 s"):
        bb.simulate(law, sensors="exact", seconds=0.1, control_dt=0.02)
    assert bb.simulate(law, sensors="exact", seconds=0.05).times[1] == pytest.approx(0.01)


class Memory:
    """A law with a memory."""

    past = 0.0

    def reset(self):
        self.past = 0.0

    def __call__(self, state):
        self.past = 0.9 * self.past + state.body_angular_velocity
        return -0.1 * self.past


@pytest.mark.parametrize("controller", ["lqr", Memory()])
def test_copies_of_an_estimated_controller_have_their_own_memory(controller):
    law = bb.EstimatedController(controller, sensors="kugle")
    alone = bb.simulate(law, **SCENE)
    first, second = copy.deepcopy(law), copy.deepcopy(law)
    readings = {"gyro": [0.1, 0.2, 0.3], "specific_force": [1.0, 0.0, 9.0], "wheel_angles": [0.0, 0.0, 0.0]}
    expected = [first(readings, bb.Setpoint()) for _ in range(3)]
    for torques in expected:
        assert np.array_equal(second(readings, bb.Setpoint()), torques)
        # Steps of one between the steps of the other change nothing.
        first(readings, bb.Setpoint())
    assert same(bb.simulate(copy.deepcopy(law), **SCENE), alone)


def test_evaluation_of_an_estimated_controller_is_of_its_copies():
    law = bb.EstimatedController("lqr", sensors="exact")
    options = {"sensors": "exact", "max_episode_steps": 20}
    assert bb.evaluate(law, episodes=3, **options).episodes == 3


def test_law_that_cannot_be_copied_is_named_whatever_it_raises():
    class Bad:
        def __deepcopy__(self, _):
            raise RuntimeError("one of a kind")

        def __call__(self, _):
            return np.zeros(3)

    with pytest.raises(TypeError, match="bad cannot be copied: one of a kind"):
        find(Bad()).copied()
    with pytest.raises(TypeError, match="bad cannot be copied for 3 robots: one of a kind"):
        bb.evaluate(Bad(), episodes=3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": [1.0]}, r"gyro has shape \(1,\), expected \(3,\)"),
        ({"gyro": [0.0, float("nan"), 0.0]}, r"gyro\[1\] = NaN"),
        ({"wheel_angles": np.zeros((3, 1))}, r"wheel_angles has shape \(3, 1\)"),
        ({"specific_force": [0.0, 0.0, -9.8]}, "no attitude at rest follows from it"),
    ],
)
def test_estimated_controller_rejects_readings_that_are_none(changes, message):
    law = bb.EstimatedController("lqr")
    readings = {"gyro": [0.0] * 3, "specific_force": [0.0, 0.0, 9.8], "wheel_angles": [0.0] * 3, **changes}
    with pytest.raises(bb.InvalidInputError, match=message):
        law(readings, bb.Setpoint())


@pytest.mark.parametrize(
    "options", [{"robot": "kugel"}, {"sensors": None}, {"control_dt": 0.0}, {"control_dt": float("nan")}]
)
def test_estimated_controller_rejects_options(options):
    (name,) = options
    with pytest.raises(ValueError, match=name):
        bb.EstimatedController("lqr", **options)


def test_estimated_controller_rejects_a_policy():
    with pytest.raises(bb.InvalidInputError, match=r"balance.onnx is a policy"):
        bb.EstimatedController(str(ASSETS / "policies" / "balance.onnx"))


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://localhost:1", "'tcp://localhost:1' is not an address of a link"),
        ("udp://localhost", "not udp://HOST:PORT"),
        ("udp://localhost:70000", "not udp://HOST:PORT"),
        ("udp://localhost:9000/x", "not udp://HOST:PORT"),
        ("udp://localhost:9000#x", "not udp://HOST:PORT"),
        ("udp://user:word@localhost:9000", "not udp://HOST:PORT"),
        ("udp://[::1", "not udp://HOST:PORT"),
        (f"udp://{'a' * 64}:9000", "not udp://HOST:PORT"),
        ("exec:a\0b", r"'exec:a\\x00b' is not an address of a link"),
        (None, "None is not an address of a link"),
        (3, "3 is not an address of a link"),
        (Path("udp:x"), r"Path\('udp:x'\) is not an address of a link"),
        ("serial:/dev/x#1", "not serial:/dev/NAME"),
        ("serial://host/dev/x", "not serial:/dev/NAME"),
        ("serial:", "not serial:/dev/NAME"),
        ("serial:/dev/x?baud=fast", "not serial:/dev/NAME"),
        ("serial:/dev/x?parity=1", "not serial:/dev/NAME"),
        ("exec:", "names no command"),
        ("exec:'", "is not a command"),
        ("stdio:", "is the address of a controller"),
    ],
)
def test_malformed_addresses_are_rejected(address, message):
    with pytest.raises(bb.InvalidInputError, match=message):
        bb.Link(address)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"timeout": 0.0}, "timeout = 0"),
        ({"timeout": float("nan")}, "timeout = nan"),
        ({"retries": -1}, "retries = -1 is out of range: expected 0 to 1000000"),
        ({"retries": 10**30}, f"retries = {10**30} is out of range: expected 0 to 1000000"),
        ({"hold": -1}, "hold = -1 is out of range: expected 0 to 1000000"),
        ({"faults": {"drop": 0.1}}, r"faults = {'drop': 0.1}: expected LinkFaults"),
        ({"give_up": -1.0}, "give_up = -1"),
        ({"connect": float("inf")}, "connect = inf"),
        ({"on_timeout": "fall"}, "on_timeout = 'fall'"),
        ({"control_dt": 0.0}, "control_dt = 0"),
        ({"log": "exchange.csv"}, "must end in .mcap"),
    ],
)
def test_options_out_of_range_are_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        bb.Link("udp://127.0.0.1:9", **options)


@pytest.mark.parametrize("options", [{"drop": 1.5}, {"corrupt": -0.1}, {"delay_time": 11.0}, {"delay": float("nan")}])
def test_faults_out_of_range_are_rejected(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} = .* is out of range"):
        bb.LinkFaults(**options)


def test_error_of_the_system_names_the_address(monkeypatch):
    with pytest.raises(OSError, match=r"udp://255\.255\.255\.255:9"):
        bb.Link("udp://255.255.255.255:9").open()

    def unknown(*_, **__):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(OSError, match=r"Name or service not known.*udp://nowhere:9"):
        bb.Link("udp://nowhere:9").open()


def test_port_in_use_is_named():
    board = Board()
    with board.socket, pytest.raises(OSError, match=board.address):
        bb.LinkPeer(Damping(), board.address)


class Batched(Damping):
    batched = True


@pytest.mark.parametrize("law", [None, 3, "lqr", Damping, Batched(), lambda state: state])
def test_peer_rejects_other_objects_than_laws_on_readings(law):
    with pytest.raises(bb.InvalidInputError, match="is not a law of one robot that reads sensors"):
        bb.LinkPeer(law, free_address())


def test_peer_serves_once():
    address = free_address()
    with serving(Damping(), address) as peer, bb.Link(address) as link:
        bb.simulate(link, sensors="exact", seconds=0.02)
    with pytest.raises(bb.InvalidInputError, match="a peer serves once"):
        peer.serve()


def test_descriptors_may_have_any_number():
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 1200:
        pytest.skip("the system permits too few files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1200), hard))
    address = free_address()
    try:
        with contextlib.ExitStack() as files:
            while files.enter_context(Path(os.devnull).open()).fileno() < 1024:
                pass
            files.enter_context(serving(Damping(), address))
            link = files.enter_context(bb.Link(address))
            assert same(bb.simulate(link, **SCENE, **TARGET), in_process())
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_standard_streams_are_as_before_after_a_peer():
    """Blocking, standard output in its place, and no other file open."""
    code = """
import os, sys
from ballbot_rs.link.transports import listen
print("before")
count = len(os.listdir("/dev/fd"))
line = listen("stdio:")
assert not os.get_blocking(0)
print("meanwhile")
line.close()
assert os.get_blocking(0) and os.get_blocking(1)
assert len(os.listdir("/dev/fd")) == count
print("after")
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATH)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        capture_output=True,
        text=True,
        env=environment,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "before\nafter\n", "meanwhile\n")


def test_program_that_does_not_exist_is_an_error():
    with pytest.raises(FileNotFoundError, match="no-such-program"):
        bb.Link("exec:no-such-program").open()


def test_port_that_does_not_exist_is_an_error():
    with pytest.raises(OSError, match="no-such-port"):
        bb.Link("serial:/dev/no-such-port").open()


def test_print_of_a_controller_does_not_disturb_its_frames(tmp_path):
    command = peer_command(tmp_path)
    script = tmp_path / "peer.py"
    script.write_text(
        script.read_text()
        .replace("(Damping()", "(Loud()")
        .replace(
            "bb.LinkPeer",
            "class Loud(Damping):\n"
            "    def __call__(self, readings, position):\n        print('a line')\n"
            "        return super().__call__(readings, position)\n\n\nbb.LinkPeer",
        )
    )
    with bb.Link(f"exec:{command} stdio:") as link:
        assert same(bb.simulate(link, **SCENE, **TARGET), in_process())
    assert link.statistics.broken == 0


def test_link_is_reopened_after_it_was_closed():
    address = free_address()
    link = bb.Link(address)
    for _ in range(2):
        with serving(Damping(), address), link:
            assert same(bb.simulate(link, **SCENE, **TARGET), in_process())


def test_missing_library_is_named(monkeypatch):
    from ballbot_rs.link import frames

    frames.cobs_library.cache_clear()
    monkeypatch.setitem(sys.modules, "cobs", None)
    with pytest.raises(ModuleNotFoundError, match=r"the link needs cobs: install it with .*\[link\]"):
        bb.Link("udp://127.0.0.1:9")
    frames.cobs_library.cache_clear()
