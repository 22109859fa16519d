"""Pages that drive: their script reads keyboard and gamepad, and sends what follows over a connection of its own.

viser has no events of keys and gamepads. Whoever drives must go on doing so: a robot whose page is silent stops.
"""

import asyncio
import functools
import time
from collections.abc import Callable
from typing import Annotated, Final

import msgspec
from websockets.asyncio.server import ServerConnection

from ballbot_rs.viewer import link
from ballbot_rs.viewer.commanding import DRIVEN
from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.session import Session

#: Where the connection is asked for.
PATH: Final = "/drive"

#: How long a command holds after the page's last message, s; the script sends one every 0.1 s.
HOLD: Final = 1.0

#: Least time between two messages of a page, s; one that sends more is read more slowly.
LEAST_PERIOD: Final = 0.005

#: Messages that a page may send in vain before it is disconnected.
MAX_REFUSED: Final = 100

Share = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]


class Restore(msgspec.Struct, forbid_unknown_fields=True):
    """The query of the address with which a page was opened."""

    restore: Annotated[str, msgspec.Meta(max_length=link.MAX_QUERY)]


_DECODER = msgspec.json.Decoder(tuple[Share, Share, Share] | Restore)


def message_of(raw: str | bytes) -> tuple[float, float, float] | Restore | None:
    """Forward, left and turn in [-1, 1], or what a link says; None if a message is neither."""
    try:
        message: tuple[float, float, float] | Restore = _DECODER.decode(raw)
        return message
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


class Driving:
    """The connections of the pages; the last one that sent something drives.

    Args:
        submit: puts a command into the queue.
    """

    def __init__(self, submit: Callable[[Command], bool]) -> None:
        self._submit = submit
        self.connections: set[ServerConnection] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_on = False
        self._sending: set[asyncio.Task[None]] = set()
        #: Who drives, and since when nothing has come, in the thread of the session.
        self._driver: ServerConnection | None = None
        self._heard = 0.0

    def __len__(self) -> int:
        """How many pages there are."""
        return len(self.connections)

    async def serve(self, connection: ServerConnection) -> None:
        """Reads a page's commands until it is gone, and stops the robot then."""
        self._loop = asyncio.get_running_loop()
        self.connections.add(connection)
        refused = 0
        try:
            await connection.send(_text(self._is_on))
            async for raw in connection:
                message = message_of(raw)
                if isinstance(message, Restore):
                    self._submit(functools.partial(link.restore, query=message.restore))
                elif message is not None:
                    self._submit(self._drive(connection, message))
                if message is not None:
                    await asyncio.sleep(LEAST_PERIOD)
                    continue
                refused += 1
                if refused > MAX_REFUSED:
                    await connection.close(1008, "too many messages that are not the page's")
        finally:
            self.connections.discard(connection)
            self._submit(self._leave(connection))

    def _drive(self, connection: ServerConnection, shares: tuple[float, float, float]) -> Command:
        def command(session: Session) -> None:
            # What was sent before the task changed, or the replay began, is no fault.
            if is_driven(session):
                session.drive(*shares)
                self._driver, self._heard = (connection if any(shares) else None), time.monotonic()

        return command

    def _leave(self, connection: ServerConnection) -> Command:
        def command(session: Session) -> None:
            if self._driver is connection:
                self._stop(session)

        return command

    def _stop(self, session: Session) -> None:
        self._driver = None
        if session.task in DRIVEN:
            session.drive(0.0, 0.0, 0.0)

    def show(self, session: Session) -> None:
        """Stops the robot of a page that is silent, and says to pages whether they may drive."""
        if self._driver is not None and time.monotonic() - self._heard > HOLD:
            self._stop(session)
            session.notices.append(f"nothing has come from the page that drove for {HOLD:g} s: the robot stops")
        if is_driven(session) != self._is_on:
            self._is_on = not self._is_on
            if self._loop is not None and self._loop.is_running():
                self._loop.call_soon_threadsafe(self._say, self._is_on)

    def _say(self, is_on: bool) -> None:
        for connection in list(self.connections):
            task = asyncio.ensure_future(connection.send(_text(is_on)))
            # The loop itself keeps no task.
            self._sending.add(task)
            task.add_done_callback(self._sent)

    def _sent(self, task: "asyncio.Task[None]") -> None:
        self._sending.discard(task)
        # Of a connection that has just been closed.
        if not task.cancelled():
            task.exception()


def is_driven(session: Session) -> bool:
    """Whether pages may drive now."""
    return session.task in DRIVEN and session.replay_time is None


def _text(is_on: bool) -> str:
    return "on" if is_on else "off"
