"""Ways of the bytes between a simulation and a controller: UDP, a serial port, a child process, standard streams.

None of them blocks longer than it is given. A stream is a file descriptor in POSIX, hence only UDP works on Windows.
"""

import contextlib
import shlex
import socket
from collections.abc import Iterator
from typing import Any, Final, Protocol
from urllib.parse import parse_qs, urlsplit

from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs.link.layout import END
from ballbot_rs.link.streams import CHUNK, Child, SerialPort, StandardStreams, is_readable

#: How addresses begin.
SCHEMES: Final = ("udp", "serial", "exec", "stdio")
FORMS: Final = "udp://HOST:PORT, serial:/dev/NAME?baud=RATE or exec:COMMAND"

BAUD: Final = 115_200


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
        while is_readable(self._socket.fileno(), deadline):
            try:
                datagram, self.sender = self._socket.recvfrom(CHUNK)
            except (BlockingIOError, ConnectionError):
                continue
            return datagram.removesuffix(END)
        return None

    def close(self) -> None:
        """As `Transport`."""
        self._socket.close()


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
