"""Controllers on the other side of a link, in a thread or a process."""

import contextlib
import os
import pty
import select
import socket
import sys
import threading
import tty
from pathlib import Path

import numpy as np

import ballbot_rs as bb
from ballbot_rs.link.frames import decode
from ballbot_rs.link.layout import Flag
from tests.support.paths import ROOT

#: A law that is quick to start, in a file for other processes; it does not balance.
LAW = """
import numpy as np


class Damping:
    reads_sensors = True
    calls = 0

    def reset(self):
        self.past = np.zeros(3)

    def __call__(self, readings, position):
        self.calls += 1
        self.past = 0.9 * self.past + readings["gyro"]
        return 0.01 * self.past - 0.002 * readings["wheel_angles"] + 1e-4 * readings["specific_force"] + position[0]
"""

_names: dict = {}
exec(LAW, _names)
Damping = _names["Damping"]


def peer_command(folder):
    """The command of a child process with the law above."""
    (folder / "law.py").write_text(LAW, encoding="utf-8")
    script = folder / "peer.py"
    script.write_text(
        f"import sys\nsys.path[:0] = {[str(ROOT / 'python'), str(folder)]!r}\n"
        "import ballbot_rs as bb\nfrom law import Damping\n"
        "bb.LinkPeer(Damping(), sys.argv[1], idle=20.0).serve()\n",
        encoding="utf-8",
    )
    return f"{sys.executable} {script}"


def free_address():
    """An address that nobody listens at."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"udp://127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def serving(law, address):
    """A peer in a thread; it has ended at the end of the context, in which the link is closed."""
    peer = bb.LinkPeer(law, address, idle=5.0)
    thread = threading.Thread(target=peer.serve)
    thread.start()
    try:
        yield peer
    finally:
        thread.join(10.0)
        assert not thread.is_alive()


@contextlib.contextmanager
def pty_pair():
    """Two addresses of serial ports that are connected with each other."""
    ends = [pty.openpty() for _ in range(2)]
    for _, slave in ends:
        tty.setraw(slave)
    masters = [master for master, _ in ends]
    done = threading.Event()

    def carry():
        while not done.is_set():
            for master in select.select(masters, [], [], 0.05)[0]:
                os.write(masters[1 - masters.index(master)], os.read(master, 4096))

    thread = threading.Thread(target=carry)
    thread.start()
    try:
        yield [f"serial:{os.ttyname(slave)}" for _, slave in ends]
    finally:
        done.set()
        thread.join()
        for end in ends:
            for descriptor in end:
                os.close(descriptor)


class Board:
    """A socket that a test answers by hand, as a board would."""

    def __init__(self):
        self.address = free_address()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        host, port = self.address.removeprefix("udp://").split(":")
        self.socket.bind((host, int(port)))
        self.socket.settimeout(0.05)
        self.place = None
        self._done = threading.Event()

    def read(self):
        """The next datagram, or None."""
        with contextlib.suppress(TimeoutError):
            datagram, self.place = self.socket.recvfrom(4096)
            return datagram
        return None

    @contextlib.contextmanager
    def answering(self, answer):
        """Calls `answer(frame)` in a thread for each frame of readings; it returns the datagrams to send."""

        def work():
            while not self._done.is_set():
                datagram = self.read()
                if datagram is None:
                    continue
                frame = decode(datagram[:-1])
                if frame.flags & Flag.STOP:
                    return
                for reply in answer(frame):
                    self.socket.sendto(reply, self.place)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            yield self
        finally:
            self._done.set()
            thread.join()
            self.socket.close()


def same(first, second):
    """Whether two trajectories are equal bit for bit."""
    return (
        len(first.states) == len(second.states)
        and all(one == other for one, other in zip(first.states, second.states, strict=True))
        and np.array_equal(first.torques, second.torques)
    )


def is_alive(process):
    """Whether a process runs; a killed one may remain as a zombie until its parent collects it."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    return False
