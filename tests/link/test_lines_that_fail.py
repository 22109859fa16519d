"""Frames that are lost, late, repeated or damaged, and controllers that hang, end or restart."""

import contextlib
import os
import signal
import socket
import struct
import subprocess
import time
import zlib

import numpy as np
import pytest
from cobs import cobs

import ballbot_rs as bb
from ballbot_rs.link import peer as peer_module
from ballbot_rs.link.faults import FaultyLine
from ballbot_rs.link.frames import Frame, decode, encode
from ballbot_rs.link.layout import READINGS, Flag, Kind, Status
from tests.support.links import Board, Damping, free_address, is_alive, peer_command, pty_pair, same, serving
from tests.support.waiting import wait_until

SCENE = {"sensors": "kugle", "tilt": (0.05, -0.02), "seconds": 0.3}
TORQUES = (0.1, -0.2, 0.3)


def reply(frame, torques=TORQUES, **changes):
    return encode(Frame(Kind.TORQUES, 0, frame.sequence, frame.time, torques)._replace(**changes))


def run(answer, seconds=0.1, **options):
    """The trajectory and the counts of a link to a board with an answer to each frame."""
    board = Board()
    options = {"timeout": 0.05, "retries": 1, **options}
    with board.answering(answer), bb.Link(board.address, **options) as link:
        return bb.simulate(link, seconds=seconds, tilt=(0.05, 0.0)), link.statistics


def silent_after(steps):
    """Answers the first frames, and none of the rest."""
    seen = set()

    def answer(frame):
        seen.add(frame.sequence)
        return [reply(frame)] if len(seen) <= steps else []

    return answer


@pytest.mark.parametrize("faults", [{"drop": 0.3}, {"corrupt": 0.3}, {"duplicate": 0.5}, {"delay": 0.3}])
def test_faults_of_a_third_of_the_frames_change_no_state(faults):
    """Readings are repeated until they are answered, and a repetition is not another step of the controller."""
    law, address = Damping(), free_address()
    faulty = bb.LinkFaults(**faults, delay_time=0.03, seed=3)
    with (
        serving(law, address) as peer,
        bb.Link(address, faults=faulty, timeout=0.01, retries=100, connect=5.0) as link,
    ):
        assert same(bb.simulate(link, **SCENE), bb.simulate(Damping(), **SCENE))
    assert law.calls == link.statistics.answered == 30
    counts = link.statistics
    (name,) = faults
    assert {
        "drop": counts.repeated,
        "corrupt": counts.corrupted + counts.broken,
        "duplicate": counts.duplicated,
        "delay": counts.late + counts.duplicated,
    }[name] > 0
    assert peer.statistics.repeated > 0


class Counting(Damping):
    resets = 0

    def reset(self):
        super().reset()
        self.resets += 1


@pytest.mark.parametrize(
    "options", [{"real_time": True, "timeout": 0.01}, {"retries": 0, "timeout": 0.005}, {"timeout": 0.005}]
)
def test_every_episode_begins_with_reset_on_a_line_that_loses_it(options):
    law, address = Counting(), free_address()
    with (
        serving(law, address),
        bb.Link(address, faults=bb.LinkFaults(drop=0.5, seed=1), control_dt=0.005, **options) as link,
    ):
        before = law.resets
        for _ in range(10):
            bb.simulate(link, sensors="exact", tilt=(0.0, 0.0), seconds=0.01)
    assert law.resets - before == 10
    assert link.statistics.repeated > 0


def test_reset_is_kept_after_an_episode_that_nobody_answered():
    board, seen = Board(), []

    def answer(frame):
        seen.append(frame)
        return []

    with board.answering(answer), bb.Link(board.address, connect=0.05) as link:
        law = link.resolved().law(bb.Params.paper(), 0.01)
        readings = {name: np.zeros(3) for name in ("gyro", "specific_force", "wheel_angles")}
        for _ in range(2):
            with pytest.raises(TimeoutError, match="no torques"):
                law(readings, bb.Setpoint())
    assert seen
    assert all(frame.flags & Flag.RESET for frame in seen)


def test_faults_on_a_serial_port_change_no_state():
    faulty = bb.LinkFaults(drop=0.2, corrupt=0.2, seed=1)
    with (
        pty_pair() as (ours, theirs),
        serving(Damping(), theirs),
        bb.Link(ours, faults=faulty, timeout=0.01, retries=100, connect=5.0) as link,
    ):
        assert same(bb.simulate(link, **SCENE), bb.simulate(Damping(), **SCENE))


def test_faults_follow_from_their_seed():
    def fates(seed):
        line = FaultyLine(bb.LinkFaults(0.2, 0.2, 0.2, 0.2, seed=seed), 0)
        return [line.passed(b"some bytes") for _ in range(200)]

    assert fates(1) == fates(1) != fates(2)


def test_faults_have_their_rates():
    line = FaultyLine(bb.LinkFaults(drop=0.1, corrupt=0.2, duplicate=0.3, delay=0.4, delay_time=0.5), 0)
    fates = [line.passed(bytes(40)) for _ in range(10_000)]
    kept = [copies for copies in fates if copies]
    # Five standard deviations.
    assert 1 - len(kept) / 10_000 == pytest.approx(0.1, abs=0.015)
    assert np.mean([any(copies[0][1]) for copies in kept]) == pytest.approx(0.2, abs=0.021)
    assert np.mean([len(copies) == 2 for copies in kept]) == pytest.approx(0.3, abs=0.024)
    assert np.mean([copies[0][0] == 0.5 for copies in kept]) == pytest.approx(0.4, abs=0.026)


def test_silence_holds_the_last_torques_then_gives_none():
    motion, counts = run(silent_after(3), hold=2)
    assert motion.torques[:5] == pytest.approx(np.tile(TORQUES, (5, 1)), rel=1e-6)
    assert not motion.torques[5:].any()
    assert (counts.answered, counts.held, counts.zeroed, counts.repeated) == (3, 2, 5, 7)


def test_silence_gives_no_torques_if_chosen():
    motion, counts = run(silent_after(3), on_timeout="zero")
    assert motion.torques[:3] == pytest.approx(np.tile(TORQUES, (3, 1)), rel=1e-6)
    assert not motion.torques[3:].any()
    assert (counts.held, counts.zeroed) == (0, 7)


def test_robot_falls_under_a_controller_that_hangs():
    motion, counts = run(silent_after(3), seconds=2.0, timeout=0.001, retries=0, give_up=60.0)
    assert motion.fell_at is not None
    assert counts.zeroed > 0


def test_controller_that_answers_again_drives_again():
    seen = []

    def answer(frame):
        seen.append(frame)
        return [] if 3 <= len(seen) <= 6 else [reply(frame)]

    motion, counts = run(answer, retries=0, hold=1)
    assert motion.torques.any(axis=1).tolist() == [True] * 3 + [False] * 3 + [True] * 5
    assert counts.answered == 6


def test_run_ends_after_silence_and_the_error_has_the_counts():
    with pytest.raises(bb.ControllerError, match=r"no torques from udp:.* for 0\.\d+ s .*3 of \d+ steps were answered"):
        run(silent_after(3), give_up=0.2, seconds=60.0)


def test_nobody_at_the_address_is_an_error():
    began = time.monotonic()
    with bb.Link(free_address(), connect=0.3) as link, pytest.raises(bb.ControllerError, match="no torques from udp:"):
        bb.simulate(link, seconds=1.0)
    assert time.monotonic() - began < 5.0


def test_answers_to_the_past_are_ignored_and_counted():
    past = []

    def answer(frame):
        past.append(frame)
        if len(past) > 3:
            return [reply(past[0], (1.0, 1.0, 1.0)), reply(past[-2], (1.0, 1.0, 1.0)), reply(frame)]
        return [reply(frame)]

    motion, counts = run(answer, timeout=0.5)
    assert motion.torques == pytest.approx(np.tile(TORQUES, (11, 1)), rel=1e-6)
    assert (counts.late, counts.duplicated, counts.answered) == (7, 7, 10)


@pytest.mark.parametrize(
    ("spoil", "damaged"),
    [
        (lambda wire: wire[:-5] + bytes([wire[-5] ^ 1]) + wire[-4:], 4),
        (lambda wire: wire[: len(wire) // 2] + b"\0", 4),
        (lambda _: b"garbage", 4),
        # The end of a frame that never began.
        (lambda _: b"\0", 0),
    ],
)
def test_damaged_answers_are_as_lost_answers(spoil, damaged):
    def answer(frame):
        good = reply(frame)
        return [spoil(good)] if frame.time else [good]

    motion, counts = run(answer, on_timeout="zero", retries=0, seconds=0.05)
    assert not motion.torques[1:].any()
    assert counts.zeroed == 4
    assert counts.broken + counts.corrupted == damaged


def of_version(version, frame):
    """A whole frame of another version."""
    packed = bytes([version]) + cobs.decode(encode(frame)[:-1])[1:-4]
    return cobs.encode(packed + struct.pack("<I", zlib.crc32(packed))) + b"\0"


def test_another_version_ends_the_run():
    """Its torques are never obeyed."""
    version = "the other side has version 1 of the frames, and this side version 2"
    with pytest.raises(bb.ControllerError, match=version):
        run(lambda frame: [of_version(1, Frame(Kind.TORQUES, 0, frame.sequence, frame.time, TORQUES))])


def test_flood_of_garbage_ends_at_the_deadline():
    def answer(frame):
        return [b"\x01" * 1000] * 200 + ([] if frame.time else [reply(frame)])

    began = time.monotonic()
    _, counts = run(answer, retries=0, seconds=0.05)
    assert time.monotonic() - began < 5.0
    assert counts.answered == 1
    assert counts.broken + counts.corrupted > 0


def test_flood_on_a_stream_ends_at_the_deadline():
    for flood in ("cat /dev/zero", "yes"):
        began = time.monotonic()
        with (
            bb.Link(f"exec:{flood}", connect=0.2, timeout=0.05) as link,
            pytest.raises(bb.ControllerError, match="no torques"),
        ):
            bb.simulate(link, seconds=1.0)
        assert time.monotonic() - began < 5.0


def test_child_that_reads_nothing_blocks_nothing():
    """Its pipe is full after some hundreds of frames."""
    with bb.Link("exec:sleep 60", connect=0.5, timeout=1e-5) as link, pytest.raises(bb.ControllerError):
        bb.simulate(link, seconds=1.0)
    assert link.statistics.unsent > 0


@pytest.mark.parametrize("code", [0, 3])
def test_child_that_ends_ends_the_run_with_its_code(code):
    with (
        bb.Link(f"exec:sh -c 'exit {code}'") as link,
        pytest.raises(bb.ControllerError, match=f"its process ended with code {code}"),
    ):
        bb.simulate(link, seconds=1.0)


class Killer:
    """A law around a link that sends its child a signal at a step."""

    reads_sensors = True

    def __init__(self, link, step, number):
        self.link, self.step, self.number, self.calls = link, step, number, 0

    def __call__(self, readings, setpoint):
        if self.calls == self.step:
            os.kill(child_of(self.link), self.number)
        self.calls += 1
        return self.link(readings, setpoint)


def child_of(link):
    return link._exchange._channel._transport._process.pid


def test_link_that_is_not_opened_completely_leaves_no_child(tmp_path):
    (tmp_path / "file").write_text("")
    pid = tmp_path / "pid"
    script = tmp_path / "child.sh"
    script.write_text(f"echo $$ > {pid}; exec sleep 300", encoding="utf-8")
    command = f"exec:sh {script}"
    with pytest.raises(OSError, match="not written"):
        bb.Link(command, log=tmp_path / "file" / "exchange.mcap").open()
    assert not pid.exists() or not pid.read_text() or not is_alive(int(pid.read_text()))


def test_log_is_complete_though_the_line_cannot_be_closed(tmp_path, monkeypatch):
    path, address = tmp_path / "exchange.mcap", free_address()
    with serving(Damping(), address):
        link = bb.Link(address, log=path)
        bb.simulate(link, sensors="exact", seconds=0.05)
        channel = link._exchange._channel
        monkeypatch.setattr(channel._transport, "close", lambda: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            link.close()
    assert path.exists()


def test_child_that_is_killed_ends_the_run(tmp_path):
    link = bb.Link(f"exec:{peer_command(tmp_path)} stdio:")
    with link, pytest.raises(bb.ControllerError, match="its process ended with code -9"):
        bb.simulate(Killer(link, 10, signal.SIGKILL), **SCENE)
    assert link.statistics.answered == 10


def test_child_that_is_stopped_is_silent_and_is_ended(tmp_path):
    link = bb.Link(f"exec:{peer_command(tmp_path)} stdio:", timeout=0.01, retries=1, hold=5, give_up=60.0)
    with link:
        motion = bb.simulate(Killer(link, 10, signal.SIGSTOP), **SCENE)
        child = child_of(link)
    assert (link.statistics.answered, link.statistics.held, link.statistics.zeroed) == (10, 5, 15)
    assert not motion.torques[15:].any()
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_child_is_collected_after_its_group_has_ended(monkeypatch):
    """Afterwards the number of the group may be the number of another."""
    alive = []
    link = bb.Link("exec:sh -c 'cat > /dev/null'").open()
    process = link._exchange._channel._transport._process
    kill = os.killpg

    def killed(group, number):
        alive.append(process.returncode is None)
        kill(group, number)

    monkeypatch.setattr(os, "killpg", killed)
    link.close()
    assert alive == [True]
    assert process.returncode == 0


def test_grandchildren_end_with_the_child(tmp_path):
    file = tmp_path / "pid"
    script = tmp_path / "parent.sh"
    script.write_text(f"sleep 300 & echo $! > {file}; wait", encoding="utf-8")
    with bb.Link(f"exec:sh {script}").open():
        wait_until(lambda: file.exists() and file.read_text())
    grandchild = int(file.read_text())
    wait_until(lambda: not is_alive(grandchild))


def test_controller_that_restarts_gives_no_torques_until_the_next_episode(tmp_path):
    """It has no state of the robot: its status is `starting`, and the robot is without torque."""
    address = free_address()
    command = [*peer_command(tmp_path).split(), address]
    link = bb.Link(address, timeout=0.05, retries=1, hold=0, give_up=60.0)

    class Restarting:
        reads_sensors = True
        calls = 0
        process = None

        def __call__(self, readings, setpoint):
            if self.calls == 10:
                self.process.kill()
                self.process.wait()
                self.process = subprocess.Popen(command)
            self.calls += 1
            return link(readings, setpoint)

    law = Restarting()
    law.process = subprocess.Popen(command)
    try:
        with link:
            first = bb.simulate(law, **{**SCENE, "seconds": 3.0}, fall_tilt=3.0, model="spatial")
            assert link.statistics.statuses["starting"] > 0
            assert link.statistics.zeroed > 0
            assert first.torques[1:10].any(axis=1).all()
            assert not first.torques[10:].any()
            again = bb.simulate(link, **SCENE)
        assert same(again, bb.simulate(Damping(), **SCENE))
    finally:
        law.process.kill()
        law.process.wait()


def frame_of(sequence, flags=0, numbers=(0.0,) * 21):
    return Frame(Kind.READINGS, int(flags), sequence, 0, numbers)


@pytest.fixture
def asked():
    """A function that sends frames to a peer in Python and returns what it answers to each, or None."""
    law, address = Damping(), free_address()
    with serving(law, address), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        host, port = address.removeprefix("udp://").split(":")
        client.connect((host, int(port)))
        client.settimeout(0.2)

        def ask(frame):
            client.send(encode(frame))
            with contextlib.suppress(TimeoutError):
                return decode(client.recv(4096)[:-1])
            return None

        ask.law = law
        yield ask
        client.send(encode(frame_of(0, Flag.STOP)))


def test_peer_that_has_not_begun_gives_no_torque(asked):
    answer = asked(frame_of(5, numbers=(1.0,) * 21))
    assert (answer.flags, answer.sequence, answer.numbers) == (Status.STARTING, 5, (0.0, 0.0, 0.0))
    assert asked(frame_of(6, Flag.RESET)).flags == Status.RUNNING


def test_peer_gives_no_torque_for_readings_that_are_not_finite(asked):
    asked(frame_of(5, Flag.RESET))
    for field in range(sum(field.length for field in READINGS)):
        numbers = [0.0] * 21
        numbers[field] = float("nan") if field % 2 else float("inf")
        answer = asked(frame_of(6 + field, numbers=tuple(numbers)))
        assert (answer.flags, answer.numbers) == (Status.NOT_FINITE, (0.0, 0.0, 0.0))
    assert asked(frame_of(30)).flags == Status.RUNNING


def test_peer_answers_repetitions_from_its_memory_and_late_readings_not(asked):
    first = asked(frame_of(2**32 - 1, Flag.RESET, (1.0,) * 21))
    second = asked(frame_of(0, numbers=(1.0,) * 21))
    assert asked(frame_of(0, numbers=(1.0,) * 21)) == second != first
    assert asked(frame_of(2**32 - 1, Flag.RESET, (1.0,) * 21)) is None
    assert asked.law.calls == 2


def test_peer_accepts_another_simulation(asked):
    asked(frame_of(1_000_000, Flag.RESET))
    assert asked(frame_of(10)) is None
    assert asked(frame_of(10, Flag.RESET)).sequence == 10
    assert asked(frame_of(11)).sequence == 11


def test_peer_answers_one_simulation():
    law, address = Counting(), free_address()
    with serving(law, address) as peer, bb.Link(address) as first, bb.Link(address, connect=0.3) as second:
        bb.simulate(first, **SCENE)
        calls = law.calls
        with pytest.raises(bb.ControllerError, match="no torques"):
            bb.simulate(second, **SCENE)
        # Its STOP does not end the peer either.
        second.close()
        assert law.calls == calls
        assert same(bb.simulate(first, **SCENE), bb.simulate(Damping(), **SCENE))
    assert peer.statistics.foreign > 1


def test_peer_answers_another_simulation_after_a_pause(monkeypatch):
    monkeypatch.setattr(peer_module, "PAUSE", 0.2)
    address = free_address()
    with serving(Damping(), address) as peer, bb.Link(address) as first, bb.Link(address) as second:
        bb.simulate(first, **SCENE)
        # It sends RESET again until the first has paused.
        assert same(bb.simulate(second, **SCENE), bb.simulate(Damping(), **SCENE))
        first.close()
        assert same(bb.simulate(second, **SCENE), bb.simulate(Damping(), **SCENE))
    assert peer.statistics.foreign > 0


def test_peer_of_another_rate_is_an_error():
    address = free_address()
    law = Damping()
    law.control_dt = 0.005
    peer = bb.LinkPeer(law, address)
    host, port = address.removeprefix("udp://").split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect((host, int(port)))
        client.send(encode(frame_of(1, Flag.RESET)))
        client.send(encode(frame_of(2)._replace(time=10_000)))
        with pytest.raises(bb.InvalidInputError, match=r"has control_dt = 0\.01 s, but Damping is made for 0\.005 s"):
            peer.serve()


def test_peer_without_a_simulation_ends():
    with pytest.raises(TimeoutError, match=r"no readings for 0\.1 s"):
        bb.LinkPeer(Damping(), free_address(), idle=0.1).serve()


def test_a_controller_that_never_answers_may_have_another_version():
    with (
        bb.Link(free_address(), connect=0.05) as link,
        pytest.raises(bb.ControllerError, match=r"no torques from .*: is it running, with frames of version 2\?"),
    ):
        bb.simulate(link, seconds=0.05)


@pytest.mark.parametrize("has_begun", [False, True])
def test_a_peer_ends_for_another_version_unless_it_serves_a_simulation(has_begun):
    address = free_address()
    host, port = address.removeprefix("udp://").split(":")
    peer = bb.LinkPeer(Damping(), address, idle=5.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect((host, int(port)))
        if has_begun:
            client.send(encode(frame_of(5, Flag.RESET)))
        client.send(of_version(1, frame_of(6, Flag.RESET)))
        client.send(encode(frame_of(0, Flag.STOP)))
        with contextlib.nullcontext() if has_begun else pytest.raises(ConnectionError, match="version 1 of the frames"):
            peer.serve()
    assert peer.statistics.unknown == 1
