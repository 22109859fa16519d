"""Frames over a transport: coded, counted, and with faults on purpose."""

import contextlib
import heapq
import itertools
import time
from typing import Any, Final

from ballbot_rs.link.faults import FaultyLine, LinkFaults
from ballbot_rs.link.frames import Frame, FrameError, decode, encode
from ballbot_rs.link.layout import END, VERSION, Kind
from ballbot_rs.link.log import ExchangeLog
from ballbot_rs.link.statistics import Statistics
from ballbot_rs.link.transports import Transport

#: Directions of faults.
_OUT: Final = 0
_IN: Final = 1


class VersionError(ConnectionError):
    """The other side has frames of another version."""

    def __init__(self, version: int) -> None:
        super().__init__(
            f"the other side has version {version} of the frames, and this side version {VERSION}: use the same "
            "ballbot_rs on both sides, and re-export the C header"
        )


class Channel:
    """One side of a link.

    Args:
        transport: carries its bytes.
        receives: the kind of frames that come from the other side; others count as unknown.
        statistics: where it counts.
        faults: of the line, in both directions; None is a perfect line.
        log: gets the bytes that are not such frames.
    """

    def __init__(
        self,
        transport: Transport,
        receives: Kind,
        statistics: Statistics,
        faults: LinkFaults | None = None,
        log: ExchangeLog | None = None,
    ) -> None:
        faults = faults or LinkFaults()
        self._transport, self._receives, self._statistics, self._log = transport, receives, statistics, log
        self._lines = FaultyLine(faults, _OUT), FaultyLine(faults, _IN)
        #: Delayed frames by the time at which they continue, of each direction.
        self._delayed: tuple[list[tuple[float, int, bytes]], ...] = ([], [])
        self._numbers = itertools.count()
        #: Whether frames of another version only count as unknown.
        self.allows_versions = False

    @property
    def sender(self) -> Any:
        """Address that the last bytes came from; None where there is one other side."""
        return self._transport.sender

    def send(self, frame: Frame) -> None:
        """Sends a frame without waiting."""
        self._delay(_OUT, encode(frame).removesuffix(END))
        self._send_due()

    def receive(self, deadline: float) -> Frame | None:
        """The next frame of the kind, None at the deadline, in s of `time.perf_counter`; other bytes are counted.

        Raises:
            VersionError: a whole frame of another version, unless `allows_versions`.
        """
        while True:
            stuffed = self._next(deadline)
            if stuffed is not None:
                try:
                    frame = decode(stuffed)
                    if frame.kind == self._receives:
                        return frame
                    self._reject(stuffed, "unknown")
                except FrameError as error:
                    self._reject(stuffed, error.count)
                    if error.version != VERSION and not self.allows_versions:
                        raise VersionError(error.version) from error
            if time.perf_counter() >= deadline:
                return None

    def close(self, last: Frame | None = None) -> None:
        """Closes the transport after a last frame, which has no faults."""
        with contextlib.suppress(OSError):
            if last is not None:
                self._transport.send(encode(last))
        self._transport.close()

    def _reject(self, stuffed: bytes, reason: str) -> None:
        self._statistics.count(reason)
        if self._log is not None:
            self._log.rejected(stuffed, reason)

    def _next(self, deadline: float) -> bytes | None:
        self._send_due()
        coming = self._delayed[_IN]
        due = min((waiting[0][0] for waiting in self._delayed if waiting), default=deadline)
        if not coming or coming[0][0] > time.perf_counter():
            stuffed = self._transport.receive(min(deadline, due))
            if stuffed is not None:
                self._delay(_IN, stuffed)
        if coming and coming[0][0] <= time.perf_counter():
            return heapq.heappop(coming)[2]
        return None

    def _delay(self, direction: int, stuffed: bytes) -> None:
        now = time.perf_counter()
        for seconds, copy in self._lines[direction].passed(stuffed) if stuffed else ():
            heapq.heappush(self._delayed[direction], (now + seconds, next(self._numbers), copy))

    def _send_due(self) -> None:
        going = self._delayed[_OUT]
        while going and going[0][0] <= time.perf_counter():
            if not self._transport.send(heapq.heappop(going)[2] + END):
                self._statistics.count("unsent")
