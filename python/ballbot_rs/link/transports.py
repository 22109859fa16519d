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
from collections.abc import Sequence
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

#: How long a child process has to leave by itself, s.
_GRACE: Final = 0.5


class ClosedError(ConnectionError):
    """The other side is gone for good; the message has the reason."""


class Transport(Protocol):
    """Carries stuffed frames; `send` and `receive` raise ClosedError where no peer can come back."""

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
        return Udp(*_host_and_port(address), is_peer=False)
    return _serial(address) if scheme == "serial" else Child(_command(rest))


def listen(address: str) -> Transport:
    """The controller's side of a link; errors as `connect`."""
    scheme, _ = _split(address)
    if scheme == "udp":
        return Udp(*_host_and_port(address), is_peer=True)
    if scheme == "serial":
        return _serial(address)
    if scheme == "stdio":
        # What the controller prints goes to standard error, not between the frames.
        sys.stdout.flush()
        kept = os.dup(sys.stdout.fileno())
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        return Stream(sys.stdin.fileno(), kept)
    raise InvalidInputError(f"{address} is an address for the simulation: a controller takes udp:, serial: or stdio:")


def _split(address: str) -> tuple[str, str]:
    scheme, colon, rest = address.partition(":")
    if not colon or scheme not in SCHEMES:
        raise InvalidInputError(f"'{address}' is not an address of a link: expected {FORMS}")
    return scheme, rest


def _host_and_port(address: str) -> tuple[str, int]:
    parts = urlsplit(address)
    port = None
    with contextlib.suppress(ValueError):
        port = parts.port
    if not parts.hostname or not port or parts.path or parts.query:
        raise InvalidInputError(f"'{address}' is not udp://HOST:PORT with a port from 1 to 65535")
    return parts.hostname, port


class Udp:
    """One frame a datagram. The simulation sends to a port, the controller to whom it heard from last."""

    def __init__(self, host: str, port: int, *, is_peer: bool) -> None:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self._to: Any = None if is_peer else place
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
            elif self._to is not None:
                self._socket.sendto(wire, self._to)
        except (BlockingIOError, ConnectionError):
            return False
        return True

    def receive(self, deadline: float) -> bytes | None:
        """As `Transport`."""
        while _is_readable(self._socket.fileno(), deadline):
            try:
                datagram, place = self._socket.recvfrom(_CHUNK)
            except (BlockingIOError, ConnectionError):
                continue
            if self._is_peer:
                self._to = place
            return datagram.removesuffix(END)
        return None

    def close(self) -> None:
        """As `Transport`."""
        self._socket.close()


class Stream:
    """Bytes of two file descriptors, which are one for a serial port."""

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
    if not parts.path or options or not baud.isdecimal():
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
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        self._kill()
        self._process.wait()
        _interrupts.endings.discard(self._kill)

    def _kill(self) -> None:
        """Ends what is left of it and of the processes that it has started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _closed(self) -> ClosedError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return ClosedError(f"its process ended with code {self._process.wait(_GRACE)}")
        return ClosedError("its process closed its output")


def _is_readable(descriptor: int, deadline: float) -> bool:
    """Whether there is something to read up to a deadline."""
    ready, _, _ = select.select([descriptor], [], [], max(deadline - time.perf_counter(), 0.0))
    return bool(ready)
