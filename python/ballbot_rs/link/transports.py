"""Ways of the bytes between a simulation and a controller: UDP, a serial port, a child process, standard streams.

None of them blocks longer than it is given. A stream is a file descriptor in POSIX, hence only UDP works on Windows.
"""

import contextlib
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, Final, Protocol
from urllib.parse import parse_qs, urlsplit

from ballbot_rs import _interrupts
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs.link.frames import Splitter
from ballbot_rs.link.layout import END

#: How addresses begin.
SCHEMES: Final = ("udp", "serial", "exec", "stdio")
FORMS: Final = "udp://HOST:PORT, serial:/dev/NAME?baud=RATE or exec:COMMAND"

BAUD: Final = 115_200

#: Bytes that are read at once.
_CHUNK: Final = 4096

#: Descriptors below can be waited for by `select`, which has finer times than `poll`.
_SELECTED: Final = 1024

#: How long a child process has to leave by itself, s.
_GRACE: Final = 0.5


class ClosedError(ConnectionError):
    """The other side is gone for good; the message has the reason."""


class Transport(Protocol):
    """Carries stuffed frames; `send` and `receive` raise ClosedError where no peer can come back."""

    #: Address that the last frame came from; None where there is one other side.
    sender: Any

    def send(self, wire: bytes) -> bool:
        """Sends a frame with its zero, without waiting; False if the system did not take it."""

    def receive(self, deadline: float) -> bytes | None:
        """The next stuffed frame without its zero; None at the deadline, in s of `time.perf_counter`."""

    def close(self) -> None:
        """Releases everything; a child process ends within a second."""


def check_address(address: str) -> None:
    """Raises ValueError for an address that the simulation cannot take."""
    scheme, rest = _split(address)
    if scheme == "udp":
        _host_and_port(address)
    elif scheme == "serial":
        _port_and_baud(address)
    elif scheme == "exec":
        _command(rest)
    else:
        raise InvalidInputError(f"{address} is the address of a controller: the simulation takes {FORMS}")


def connect(address: str) -> Transport:
    """The simulation's side of a link.

    Raises:
        ValueError: as `check_address`.
        OSError: there is no such port, host or program.
    """
    check_address(address)
    scheme, rest = _split(address)
    if scheme == "udp":
        with _named(address):
            return Udp(*_host_and_port(address), is_peer=False)
    return _serial(address) if scheme == "serial" else Child(_command(rest))


def listen(address: str) -> Transport:
    """The controller's side of a link; errors as `connect`."""
    scheme, _ = _split(address)
    if scheme == "udp":
        with _named(address):
            return Udp(*_host_and_port(address), is_peer=True)
    if scheme == "serial":
        return _serial(address)
    if scheme == "stdio":
        return StandardStreams()
    raise InvalidInputError(f"{address} is an address for the simulation: a controller takes udp:, serial: or stdio:")


def _split(address: str) -> tuple[str, str]:
    scheme = address.partition(":")[0] if isinstance(address, str) else ""
    if scheme not in SCHEMES or ":" not in address or "\0" in address:
        raise InvalidInputError(f"{address!r} is not an address of a link: expected {FORMS}")
    return scheme, address[len(scheme) + 1 :]


def _host_and_port(address: str) -> tuple[str, int]:
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
        # The resolver takes no other names.
        (host or "").encode("idna")
    except ValueError:
        host = port = None
    if not host or not port or "@" in address or parts.path or parts.query or parts.fragment:
        raise InvalidInputError(f"'{address}' is not udp://HOST:PORT with a port from 1 to 65535")
    return host, port


@contextlib.contextmanager
def _named(address: str) -> Iterator[None]:
    """Adds the address to errors of the system."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, address) from error


class Udp:
    """One frame a datagram. The simulation sends to a port, the controller to `sender`."""

    def __init__(self, host: str, port: int, *, is_peer: bool) -> None:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self.sender: Any = None
        try:
            self._socket.setblocking(False)
            if is_peer:
                self._socket.bind(place)
            else:
                # The system drops what others send to it.
                self._socket.connect(place)
        except OSError:
            self._socket.close()
            raise
        self._is_peer = is_peer

    def send(self, wire: bytes) -> bool:
        """As `Transport`; nobody listening at the port is as a lost frame."""
        try:
            if not self._is_peer:
                self._socket.send(wire)
            elif self.sender is not None:
                self._socket.sendto(wire, self.sender)
        except (BlockingIOError, ConnectionError):
            return False
        return True

    def receive(self, deadline: float) -> bytes | None:
        """As `Transport`."""
        while _is_readable(self._socket.fileno(), deadline):
            try:
                datagram, self.sender = self._socket.recvfrom(_CHUNK)
            except (BlockingIOError, ConnectionError):
                continue
            return datagram.removesuffix(END)
        return None

    def close(self) -> None:
        """As `Transport`."""
        self._socket.close()


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
            if not _is_readable(self._in, deadline):
                return None
            try:
                chunk = os.read(self._in, _CHUNK)
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
    """Those of this process; what it prints goes to standard error meanwhile, not between the frames."""

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


def _port_and_baud(address: str) -> tuple[str, int]:
    parts = urlsplit(address)
    options = {name: values[-1] for name, values in parse_qs(parts.query, keep_blank_values=True).items()}
    baud = options.pop("baud", str(BAUD))
    if not parts.path or parts.netloc or parts.fragment or options or not baud.isdecimal():
        raise InvalidInputError(f"'{address}' is not serial:/dev/NAME or serial:/dev/NAME?baud=RATE")
    return parts.path, int(baud)


def _serial(address: str) -> SerialPort:
    path, baud = _port_and_baud(address)
    with require("a serial port", "link"):
        import serial
    try:
        return SerialPort(serial.Serial(path, baud, timeout=0, write_timeout=0))
    # The number of bits a second is an error of the driver.
    except (serial.SerialException, ValueError, OverflowError) as error:
        raise OSError(f"{address}: {error}") from error


def _command(text: str) -> list[str]:
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InvalidInputError(f"'exec:{text}' is not a command: {error}") from error
    if not words:
        raise InvalidInputError(f"'exec:{text}' names no command: expected exec:COMMAND")
    return words


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


def _is_readable(descriptor: int, deadline: float) -> bool:
    """Whether there is something to read up to a deadline."""
    seconds = max(deadline - time.perf_counter(), 0.0)
    if descriptor < _SELECTED or sys.platform == "win32":
        return bool(select.select([descriptor], [], [], seconds)[0])
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(1e3 * seconds))
