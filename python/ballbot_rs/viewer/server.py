"""A viser server for this machine alone: whoever asks from elsewhere, or for other files, is turned away."""

import asyncio
import contextlib
import functools
import http
import io
import re
import socket
import time
import urllib.parse
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

HOST = "127.0.0.1"

#: Names by which a browser on this machine may call it; a tunnel may use another port.
OWN_NAMES = ("127.0.0.1", "localhost", "::1")


#: The analytics script of viser's page, which is removed.
ANALYTICS = re.compile(rb"<script(?:(?!</script>).)*(?:googletagmanager|gtag)(?:(?!</script>).)*</script>", re.DOTALL)


class LocalServer(viser.ViserServer):
    """A viser server that cannot be shared with the internet."""

    def __init__(self, port: int) -> None:
        with _guarded() as guards, contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=HOST, port=port, label="ballbot", verbose=False)
        if not guards:
            super().stop()
            raise RuntimeError(f"viser {viser.__version__} serves its page in another way: it cannot be restricted")

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002
        """Refuses: what a page asks for must not open this machine to others."""
        return None

    def stop(self) -> None:
        """Ends the server, quietly."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()
            # The server's thread says so when it ends, which it does not tell otherwise.
            deadline = time.monotonic() + 2.0
            while self._event_loop.is_running() and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(0.05)
        if not self._event_loop.is_running():
            # What waits for messages would be complained about when Python ends.
            self._event_loop.run_until_complete(_cancel_all())


async def _cancel_all() -> None:
    waiting = asyncio.all_tasks() - {asyncio.current_task()}
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)
    await asyncio.get_running_loop().shutdown_asyncgens()


def free_port(first: int) -> int:
    """The first free port from `first` on. viser would look beyond the last one that there is, and wait for ever.

    Raises:
        OSError: there is none.
    """
    for port in range(first, 65536):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe, contextlib.suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
            return port
    raise OSError(f"no port is free from {first} to 65535")


def refusal(path: str, headers: Headers) -> str | None:
    """Why a request is refused, or None.

    A path may not leave the client's folder, which viser does not check. A foreign `Origin` is another site's page that
    reaches for this server; a foreign `Host` is the same after its name was pointed at this machine.
    """
    file = path.partition("?")[0]
    if ".." in file.split("/") or "//" in file or any(c in file for c in "\\:") or "%5c" in file.lower():
        return "no such file"
    for value, is_host in [
        *((v, True) for v in headers.get_all("Host")),
        *((v, False) for v in headers.get_all("Origin")),
    ]:
        try:
            name = urllib.parse.urlsplit(f"//{value}" if is_host else value).hostname
        except ValueError:
            name = None
        if name not in OWN_NAMES:
            return "this server is for this machine alone"
    return None


@contextlib.contextmanager
def _guarded() -> Iterator[list[bool]]:
    """Puts `refusal` before viser's own answers, for which viser has no hook.

    The list is empty as long as viser has not started a server through it.
    """
    serve = websockets.asyncio.server.serve
    guards: list[bool] = []

    def guarded(*arguments: Any, process_request: Callable[[ServerConnection, Request], Any], **options: Any) -> Any:
        @functools.wraps(process_request)
        def answer(connection: ServerConnection, request: Request) -> Any:
            reason = refusal(request.path, request.headers)
            if reason is not None:
                return Response(http.HTTPStatus.FORBIDDEN.value, "Forbidden", Headers(), reason.encode())
            is_page = request.path.partition("?")[0] in ("/", "/index.html")
            if is_page:
                request.headers.pop("Accept-Encoding", None)
            response = process_request(connection, request)
            if is_page and isinstance(response, Response):
                response.body = ANALYTICS.sub(b"", response.body)
            return response

        guards.append(True)
        return serve(*arguments, process_request=answer, **options)

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment]
    try:
        yield guards
    finally:
        websockets.asyncio.server.serve = serve
