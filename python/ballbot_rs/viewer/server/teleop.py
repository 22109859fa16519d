"""Pages that drive: their script reads keyboard and gamepad, and sends commands over a separate connection.

viser has no keyboard and gamepad events. Driving requires continuous messages: a robot whose page is silent stops.
"""

import asyncio
import functools
import time
from collections.abc import Callable
from typing import Annotated, Final

import msgspec
from websockets.asyncio.server import ServerConnection

from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.viewer.server import link
from ballbot_rs.viewer.session.commanding import DRIVEN
from ballbot_rs.viewer.session.runner import Command, Submit
from ballbot_rs.viewer.session.session import Session

#: Path of the connection.
PATH: Final = "/drive"

#: How long a command holds after the page's last message, s; the script sends a message every 0.1 s.
HOLD: Final = 1.0

#: Least time between two messages of a page, s; more frequent messages are read more slowly.
LEAST_PERIOD: Final = 0.005

#: Invalid messages that a page may send before it is disconnected.
MAX_REJECTED: Final = 100

Fraction = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]


class Report(msgspec.Struct, forbid_unknown_fields=True):
    """What a page reports."""

    #: The query of the address with which it was opened.
    restore: Annotated[str, msgspec.Meta(max_length=link.MAX_QUERY)] | None = None
    #: Whether its system has dark windows.
    dark: bool | None = None
    #: The key that puts the camera behind the robot, and back.
    chase: bool = False


_DECODER = msgspec.json.Decoder(tuple[Fraction, Fraction, Fraction] | Report)


def message_of(raw: str | bytes) -> tuple[float, float, float] | Report | None:
    """Forward, left and turn in [-1, 1], or a report; None if a message is neither."""
    try:
        message: tuple[float, float, float] | Report = _DECODER.decode(raw)
        return message
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


class Teleop:
    """The connections of the pages; the page with the last message drives.

    Args:
        submit: puts a command into the queue.
    """

    def __init__(self, submit: Submit) -> None:
        self._submit = submit
        #: Called in the thread of the session with a report of a page.
        self.on_report: Callable[[Report], None] = lambda _: None
        self.connections: set[ServerConnection] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_on = False
        self._sending: set[asyncio.Task[None]] = set()
        #: The driving page, and since when it has been silent, in the thread of the session.
        self._driver: ServerConnection | None = None
        self._heard = 0.0

    def __len__(self) -> int:
        """Number of pages."""
        return len(self.connections)

    async def serve(self, connection: ServerConnection) -> None:
        """Reads a page's commands until it disconnects, then stops the robot."""
        self._loop = asyncio.get_running_loop()
        self.connections.add(connection)
        rejected = 0
        try:
            await connection.send(_text(self._is_on))
            async for raw in connection:
                message = message_of(raw)
                if isinstance(message, Report):
                    self._submit(self._reported(message))
                elif message is not None:
                    self._submit(self._drive(connection, message))
                if message is not None:
                    await asyncio.sleep(LEAST_PERIOD)
                    continue
                rejected += 1
                if rejected > MAX_REJECTED:
                    await connection.close(1008, "too many messages that are not the page's")
        finally:
            self.connections.discard(connection)
            self._submit(self._leave(connection))

    def _reported(self, report: Report) -> Command:
        if report.restore is not None:
            return functools.partial(link.restore, query=report.restore)
        return lambda _: self.on_report(report)

    def _drive(self, connection: ServerConnection, fractions: tuple[float, float, float]) -> Command:
        def command(session: Session) -> None:
            # Messages sent before the task changed, or the replay began, are not errors.
            if is_driven(session):
                session.drive(*fractions)
                self._driver, self._heard = (connection if any(fractions) else None), time.monotonic()

        return command

    def _leave(self, connection: ServerConnection) -> Command:
        def command(session: Session) -> None:
            if self._driver is connection:
                self._stop(session)

        return command

    def _stop(self, session: Session) -> None:
        self._driver = None
        if geometry_of(session.task) == DRIVEN:
            session.drive(0.0, 0.0, 0.0)

    def show(self, session: Session) -> None:
        """Stops the robot of a silent page, and notifies pages whether they may drive."""
        if self._driver is not None and time.monotonic() - self._heard > HOLD:
            self._stop(session)
            session.notices.append(f"nothing has come from the page that drove for {HOLD:g} s: the robot stops")
        if is_driven(session) != self._is_on:
            self._is_on = not self._is_on
            if self._loop is not None and self._loop.is_running():
                self._loop.call_soon_threadsafe(self._send, self._is_on)

    def _send(self, is_on: bool) -> None:
        for connection in list(self.connections):
            task = asyncio.ensure_future(connection.send(_text(is_on)))
            # The loop itself does not keep references to tasks.
            self._sending.add(task)
            task.add_done_callback(self._sent)

    def _sent(self, task: "asyncio.Task[None]") -> None:
        self._sending.discard(task)
        # From a connection that was just closed.
        if not task.cancelled():
            task.exception()


def is_driven(session: Session) -> bool:
    """Whether pages may drive now."""
    return geometry_of(session.task) == DRIVEN and session.replay_time is None


def _text(is_on: bool) -> str:
    return "on" if is_on else "off"
