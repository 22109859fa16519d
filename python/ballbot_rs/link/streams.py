"""Streams of bytes between a simulation and a controller: file descriptors in POSIX."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, Final

from ballbot_rs import _interrupts
from ballbot_rs.link.frames import Splitter
from ballbot_rs.link.layout import END

#: Bytes that are read at once.
CHUNK: Final = 4096

#: Descriptors below can be waited for by `select`, which has finer times than `poll`.
_SELECTED: Final = 1024

#: How long a child process has to leave by itself, s.
_GRACE: Final = 0.5


class ClosedError(ConnectionError):
    """The other side is gone for good; the message has the reason."""


class Stream:
    """Bytes of two file descriptors, which are one for a serial port."""

    sender = None

    def __init__(self, read_from: int, write_to: int) -> None:
        self._in, self._out = read_from, write_to
        self._splitter = Splitter()
        self._received: deque[bytes] = deque()
        self._is_cut = True
        for descriptor in (read_from, write_to):
            os.set_blocking(descriptor, False)

    def send(self, wire: bytes) -> bool:
        """As `Transport`; a zero ends what came before on the line, as noise or a frame that was cut."""
        whole = END + wire if self._is_cut else wire
        try:
            written = os.write(self._out, whole)
        except BlockingIOError:
            return False
        except OSError as error:
            raise self._closed() from error
        self._is_cut = written < len(whole)
        return not self._is_cut

    def receive(self, deadline: float) -> bytes | None:
        """As `Transport`."""
        while not self._received:
            if not is_readable(self._in, deadline):
                return None
            try:
                chunk = os.read(self._in, CHUNK)
            except BlockingIOError:
                continue
            except OSError as error:
                raise self._closed() from error
            if not chunk:
                raise self._closed()
            self._received.extend(self._splitter.feed(chunk))
            # Without frames, a flood of bytes ends at the deadline, too.
            if not self._received and time.perf_counter() > deadline:
                return None
        return self._received.popleft()

    def close(self) -> None:
        """As `Transport`."""

    def _closed(self) -> ClosedError:
        return ClosedError("the line was closed")


class StandardStreams(Stream):
    """Standard streams of this process; what it prints goes to standard error meanwhile, not between the frames."""

    def __init__(self) -> None:
        sys.stdout.flush()
        self._printed = sys.stdout.fileno()
        read_from, write_to = sys.stdin.fileno(), os.dup(self._printed)
        # Other processes may use the same open files: a shell the terminal.
        self._blocking = {descriptor: os.get_blocking(descriptor) for descriptor in (read_from, write_to)}
        super().__init__(read_from, write_to)
        os.dup2(sys.stderr.fileno(), self._printed)
        _interrupts.endings.add(self._restore)

    def close(self) -> None:
        """As `Transport`."""
        if self._restore in _interrupts.endings:
            sys.stdout.flush()
            _interrupts.endings.discard(self._restore)
            self._restore()
            os.dup2(self._out, self._printed)
            os.close(self._out)

    def _restore(self) -> None:
        for descriptor, is_blocking in self._blocking.items():
            os.set_blocking(descriptor, is_blocking)


class SerialPort(Stream):
    """A serial port or a pseudoterminal."""

    def __init__(self, port: Any) -> None:
        self._port = port
        super().__init__(port.fileno(), port.fileno())

    def close(self) -> None:
        """As `Transport`."""
        self._port.close()


class Child(Stream):
    """A child process, which reads its standard input and writes its standard output."""

    def __init__(self, command: Sequence[str]) -> None:
        try:
            # Ctrl-C in a terminal reaches only this process, which ends the child and what the child has started.
            with _interrupts.unbroken():
                self._process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, start_new_session=True
                )
                _interrupts.endings.add(self._kill)
        except KeyboardInterrupt:
            self.close()
            raise
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        super().__init__(self._process.stdout.fileno(), self._process.stdin.fileno())

    def close(self) -> None:
        """As `Transport`."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._end()

    def _end(self) -> bool:
        """Whether it leaves by itself; ends what is left of it and of the processes that it has started."""
        if self._process.returncode is not None:
            return True
        leaves = self._leaves()
        # Once it is collected, its number may be the number of another group.
        self._kill()
        _interrupts.endings.discard(self._kill)
        self._process.wait()
        return leaves

    def _leaves(self) -> bool:
        """Whether it ends in time; it is not collected."""
        ends = time.perf_counter() + _GRACE
        while time.perf_counter() < ends:
            # Not on macOS before Python 3.13, where it has the whole time.
            if hasattr(os, "waitid") and os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                return True
            time.sleep(0.002)
        return False

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _closed(self) -> ClosedError:
        if self._end():
            return ClosedError(f"its process ended with code {self._process.returncode}")
        return ClosedError("its process closed its output")


def is_readable(descriptor: int, deadline: float) -> bool:
    """Whether there is something to read up to a deadline."""
    seconds = max(deadline - time.perf_counter(), 0.0)
    if descriptor < _SELECTED or sys.platform == "win32":
        return bool(select.select([descriptor], [], [], seconds)[0])
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(1e3 * seconds))
