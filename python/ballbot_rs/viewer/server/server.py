"""A viser server for this machine only: requests from elsewhere, or for other files, are rejected."""

import asyncio
import contextlib
import ctypes
import functools
import gc
import http
import io
import logging
import re
import socket
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.viewer.server import messages, teleop
from ballbot_rs.viewer.server.head import DOCUMENTATION, DOCUMENTATION_PATH, with_head

#: Host names that a browser on this machine may use; a tunnel may use another port.
AUTHORITY = re.compile(r"(?:127\.0\.0\.1|localhost|\[::1\])(?::(\d{1,5}))?", re.ASCII | re.IGNORECASE)
ORIGIN = re.compile(r"https?://(.*)", re.ASCII | re.IGNORECASE | re.DOTALL)

ELSEWHERE = "this server is only for this machine"

HOST = "127.0.0.1"

#: Most open pages. Each costs memory: viser encodes everything for each of them.
MAX_CLIENTS = 16
FULL = f"{MAX_CLIENTS} pages of this server are open already, which is the limit: close one"

#: Subprotocol that viser's page requests: the version that made it.
PROTOCOL = f"viser-v{viser.__version__}"

#: Most messages per second of a client; more are read more slowly. The page's own throttle is below that.
MAX_RATE = 200.0

#: Invalid messages that a client may send before it is disconnected.
MAX_REJECTED = 100

#: Longest time to close a connection, s.
CLOSE_TIMEOUT = 0.02

#: Time from closing a page to returning its memory, s: once for pages closed together.
GIVE_BACK_AFTER = 1.0


def rejection(path: str, headers: Headers) -> str | None:
    """The reason for refusing a request, or None.

    A path must not leave the client's folder, which viser does not check. A foreign `Host` is another site's page whose
    name was pointed at this machine (DNS rebinding). A foreign `Origin` is another page, possibly on this machine, that
    accesses this server. Programs other than browsers send no `Origin`.
    """
    file = path.partition("?")[0]
    if ".." in file.split("/") or "//" in file or any(c in file for c in "\\:") or "%5c" in file.lower():
        return "no such file"
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not is_own(hosts[0]) or len(origins) > 1:
        return ELSEWHERE
    for origin in origins:
        match = ORIGIN.fullmatch(origin)
        if match is None or not is_own(match[1]) or match[1].lower() != hosts[0].lower():
            return ELSEWHERE
    return None


def is_own(authority: str) -> bool:
    """Whether HOST or HOST:PORT, strictly as in RFC 3986, names this machine."""
    match = AUTHORITY.fullmatch(authority)
    return match is not None and (match[1] is None or 1 <= int(match[1]) <= 65535)


class LocalServer(viser.ViserServer):
    """A viser server that cannot be shared with the internet.

    Args:
        port: where it listens.
        pages: the connections of the pages that drive.
    """

    def __init__(self, port: int, pages: teleop.Teleop) -> None:
        self._clients: set[ServerConnection] = set()
        self._teleop = pages
        self._gives_back = False
        self._unheard = contextlib.ExitStack()
        with _guarded(self) as guards, contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=HOST, port=port, label="ballbot", verbose=False)
        if not guards:
            super().stop()
            raise RuntimeError(f"viser {viser.__version__} serves its page in another way: it cannot be restricted")

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002
        """Rejects them: a page must not open this machine to others."""
        return None

    async def serve(self, handler: Callable[[Any], Awaitable[None]], connection: ServerConnection) -> None:
        """Has viser serve a client, and passes on only valid messages.

        A driving connection does not go to viser.
        """
        if self.is_for_driving(connection.request):
            await self._teleop.serve(connection)
            return
        if self.is_full:
            await connection.close(1013, FULL)
            return
        if connection.subprotocol != PROTOCOL:
            # viser would print this to the terminal.
            await connection.close(1002, f"this server speaks {PROTOCOL}: load the page again")
            return
        self._clients.add(connection)
        try:
            await handler(_Client(connection, self))
        finally:
            self._clients.discard(connection)
            # Ends the tasks that wait for messages to this client.
            self._websock_server.flush()
            if not self._gives_back:
                self._gives_back = True
                asyncio.get_running_loop().call_later(GIVE_BACK_AFTER, self._give_back)

    def _give_back(self) -> None:
        self._gives_back = False
        give_back_memory()

    def is_for_driving(self, request: Request | None) -> bool:
        """Whether a request is for a driving connection."""
        return request is not None and request.path == teleop.PATH

    def is_full_for(self, request: Request) -> bool:
        """Whether the limit for this kind of request is reached."""
        if self.is_for_driving(request):
            return len(self._teleop) >= MAX_CLIENTS
        return self.is_full

    @property
    def is_full(self) -> bool:
        """Whether the limit of open pages is reached."""
        return len(self._clients) >= MAX_CLIENTS

    @property
    def controls(self) -> dict[str, Any]:
        """The controls on the page by their identifiers."""
        return self.gui._gui_input_handle_from_uuid if hasattr(self, "gui") else {}

    def _abort(self) -> None:
        for connection in (*self._clients, *self._teleop.connections):
            connection.transport.abort()

    def stop(self) -> None:
        """Ends the server quietly, without waiting for clients that do not answer."""
        # A frame in progress is lost, and a thread that viser calls back may be late.
        for handler in (self._websock_server, *(one._websock_connection for one in self.get_clients().values())):
            self._unheard.enter_context(unheard(handler))
        with contextlib.redirect_stdout(io.StringIO()):
            with contextlib.suppress(RuntimeError):
                # The loop may have ended with the interpreter.
                self._event_loop.call_soon_threadsafe(self._abort)
            super().stop()


def unheard(handler: Any) -> contextlib.AbstractContextManager[None]:
    """A context in which viser does not warn of messages to a closed page."""
    buffer = handler.get_message_buffer()
    # Versions without it do not warn.
    without: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext
    return getattr(buffer, "sanctioned_dead_writes", without)()


def give_back_memory() -> None:
    """Returns unused memory to the system, where the C library keeps it."""
    # viser's handles of a client refer to each other.
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def free_port(first: int) -> int:
    """The first free port from `first`. viser would search past the last port, and wait forever.

    Raises:
        ValueError: a port out of range.
        OSError: no port is free.
    """
    if not 1 <= first <= 65535:
        raise InvalidInputError(f"port = {first} is out of range: expected 1 to 65535")
    for port in range(first, 65536):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe, contextlib.suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
            return port
    raise OSError(f"no port is free from {first} to 65535")


class _Client:
    """A connection with viser's interface that only delivers valid messages."""

    def __init__(self, connection: ServerConnection, server: LocalServer) -> None:
        self._connection = connection
        self._server = server
        self._allowed = MAX_RATE
        self._last = time.monotonic()
        self._rejected = 0
        self._has_camera = False
        self.subprotocol = connection.subprotocol

    async def send(self, message: bytes) -> None:
        """Sends to the client."""
        await self._connection.send(message)

    async def recv(self) -> bytes:
        """The client's next valid message."""
        while True:
            raw = await self._connection.recv()
            await self._slow_down()
            message = messages.accepted(raw, self._server.controls)
            # viser has no handle of a client before its first camera message.
            self._has_camera = self._has_camera or isinstance(message, messages.Camera)
            if message is not None and self._has_camera:
                return messages.encoded(message)
            self._rejected += 1
            if self._rejected > MAX_REJECTED:
                await self._connection.close(1008, "too many messages that are not the page's")

    async def _slow_down(self) -> None:
        now = time.monotonic()
        self._allowed = min(MAX_RATE, self._allowed + MAX_RATE * (now - self._last)) - 1.0
        self._last = now
        if self._allowed < 0.0:
            await asyncio.sleep(-self._allowed / MAX_RATE)


@contextlib.contextmanager
def _guarded(server: LocalServer) -> Iterator[list[bool]]:
    """Puts `rejection` and `_Client` before viser, which has no hook for either.

    The list is empty until viser has started a server through it.
    """
    serve = websockets.asyncio.server.serve
    guards: list[bool] = []

    def guarded(
        handler: Callable[[Any], Awaitable[None]],
        *arguments: Any,
        process_request: Callable[[ServerConnection, Request], Any],
        **options: Any,
    ) -> Any:
        @functools.wraps(process_request)
        def answer(connection: ServerConnection, request: Request) -> Any:
            reason = rejection(request.path, request.headers)
            if reason is not None:
                return _rejected(http.HTTPStatus.FORBIDDEN, reason)
            if request.path == DOCUMENTATION_PATH:
                return _documentation()
            is_page = request.path.partition("?")[0] in ("/", "/index.html")
            is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
            if (is_page or is_socket) and server.is_full_for(request):
                return _rejected(http.HTTPStatus.SERVICE_UNAVAILABLE, FULL)
            if is_page:
                request.headers.pop("Accept-Encoding", None)
            response = process_request(connection, request)
            if is_page and isinstance(response, Response):
                response.body = with_head(bytes(response.body))
                del response.headers["Content-Length"]
                response.headers["Content-Length"] = str(len(response.body))
            return response

        guards.append(True)
        own = {"max_size": messages.MAX_MESSAGE, "close_timeout": CLOSE_TIMEOUT, "logger": _silent_logger()}
        return serve(functools.partial(server.serve, handler), *arguments, process_request=answer, **{**options, **own})

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield guards
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _rejected(status: http.HTTPStatus, reason: str) -> Response:
    return _text(status, reason.encode())


def _text(status: http.HTTPStatus, content: bytes) -> Response:
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Connection": "close"})
    return Response(status.value, status.phrase, headers, content)


def _documentation() -> Response:
    if not DOCUMENTATION.is_file():
        return _text(http.HTTPStatus.NOT_FOUND, b"the documentation is in the folder docs of the repository")
    return _text(http.HTTPStatus.OK, DOCUMENTATION.read_bytes())


def _silent_logger() -> logging.Logger:
    """Client errors are not printed: clients could flood the terminal."""
    logger = logging.getLogger("ballbot_rs.viewer.connections")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger
