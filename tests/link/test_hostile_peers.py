"""Controllers that flood, lie about times, come and go, or lose their line."""

import os
import pty
import sys
import threading
import time
import tty
from pathlib import Path

import pytest

import ballbot_rs as bb
from ballbot_rs.link.frames import WRAP, Frame, encode
from ballbot_rs.link.layout import Kind
from tests.support.commands import run
from tests.support.links import Board, Damping, free_address, same, serving

TORQUES = (0.01, -0.02, 0.01)


def reply(frame, time_of_answer=None, torques=TORQUES):
    at = frame.time if time_of_answer is None else time_of_answer
    return encode(Frame(Kind.TORQUES, 0, frame.sequence, at, torques))


def descriptors():
    """How many this process has open."""
    return len(list(Path("/dev/fd").iterdir()))


def motion(answer):
    """The motion and the counts under a board with an answer to each frame."""
    board = Board()
    with board.answering(answer), bb.Link(board.address) as link:
        return bb.simulate(link, seconds=0.1, tilt=(0.05, 0.0)), link.statistics


def test_ten_answers_to_each_frame_are_as_one():
    one, _ = motion(lambda frame: [reply(frame)])
    ten, counts = motion(lambda frame: [reply(frame)] * 10)
    assert same(one, ten)
    assert (counts.answered, counts.steps) == (10, 10)
    # What is still on the line after the last step is not read.
    assert counts.duplicated >= 80


def test_times_of_answers_do_not_matter():
    one, _ = motion(lambda frame: [reply(frame)])
    backward, counts = motion(lambda frame: [reply(frame, -frame.time % WRAP)])
    assert same(one, backward)
    assert counts.answered == 10


def test_a_peer_that_listens_again_and_again_serves_each_episode():
    address = free_address()
    before = descriptors()
    for _ in range(100):
        with serving(Damping(), address), bb.Link(address) as link:
            assert link.open() is link
            bb.simulate(link, seconds=0.02)
            assert link.statistics.answered == 2
    assert descriptors() == before


def test_a_line_that_is_opened_a_hundred_times_leaves_nothing():
    before = descriptors()
    with bb.Link("exec:cat") as link:
        for _ in range(100):
            link.open()
            link.close()
    # Nobody reads at the other end.
    master, slave = pty.openpty()
    tty.setraw(slave)
    for _ in range(100):
        with bb.Link(f"serial:{os.ttyname(slave)}") as link:
            link.open()
    os.close(master)
    os.close(slave)
    assert descriptors() == before


@pytest.mark.parametrize("side", ["simulation", "controller"])
def test_a_port_that_is_closed_in_between_ends_both_sides(side):
    master, slave = pty.openpty()
    tty.setraw(slave)
    address = f"serial:{os.ttyname(slave)}"
    closing = threading.Timer(0.2, os.close, [master])
    # Both open the line first: there is none after it is closed.
    if side == "simulation":
        with bb.Link(address, connect=60.0) as link:
            link.open()
            began = time.monotonic()
            closing.start()
            with pytest.raises(bb.ControllerError, match="ClosedError: the line was closed"):
                bb.simulate(link, seconds=1.0)
    else:
        peer = bb.LinkPeer(Damping(), address, idle=60.0)
        began = time.monotonic()
        closing.start()
        peer.serve()
    # Long before either gives up a line that is silent.
    assert time.monotonic() - began < 30.0
    closing.join()
    os.close(slave)


#: A child that answers with a torque, and meanwhile does something else; it needs no package but ours.
CHILD = """
import os, signal, sys, threading
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
sys.path.insert(0, {path!r})
from ballbot_rs.link.frames import Frame, Splitter, decode, encode
from ballbot_rs.link.layout import Kind

def fill():
    while True:
        os.write(2, b"x" * 65536)

if {fills}:
    threading.Thread(target=fill, daemon=True).start()
splitter = Splitter()
while chunk := os.read(0, 4096):
    for stuffed in splitter.feed(chunk):
        frame = decode(stuffed) if stuffed else None
        if frame is not None:
            os.write(1, encode(Frame(Kind.TORQUES, 0, frame.sequence, frame.time, ({torque}, 0.0, 0.0))))
"""


def child(folder, fills, torque="0.0"):
    script = Path(folder) / "child.py"
    path = str(Path(bb.__file__).parents[1])
    script.write_text(CHILD.format(path=path, fills=fills, torque=torque), encoding="utf-8")
    return f"exec:{sys.executable} {script}"


@pytest.mark.slow("starts two processes, which import the package")
def test_a_child_that_fills_its_standard_error_changes_nothing(tmp_path):
    done = run("link", child(tmp_path, fills=True), "--sensors", "exact", "--seconds", "0.1")
    assert done.returncode == 0
    assert "10 of 10 steps answered in time" in done.stdout


@pytest.mark.slow("starts two processes, which import the package")
def test_torques_that_are_not_finite_end_the_command_with_the_counts(tmp_path):
    done = run("link", child(tmp_path, fills=False, torque='float("inf")'), "--sensors", "exact")
    assert done.returncode == 1
    assert done.stderr.startswith("1 of 1 steps answered in time\n")
    assert done.stderr.endswith("ballbot: link gave the torques [inf 0. 0.] N·m: they must be finite\n")
