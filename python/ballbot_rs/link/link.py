"""A controller in another process or on a board, as a law: readings go out, torques come back."""

from __future__ import annotations

import contextlib
import operator
import weakref
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from secrets import randbits
from types import NoneType, TracebackType
from typing import Any, Final, Literal, NoReturn

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

from ballbot_rs._checks import check_bounded
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs.control import resolve
from ballbot_rs.control.resolve import CONTROL_DT, ResolvedController
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.link.channel import Channel
from ballbot_rs.link.exchange import Exchange, Timing
from ballbot_rs.link.faults import LinkFaults
from ballbot_rs.link.frames import WRAP, Frame, cobs_library
from ballbot_rs.link.layout import READINGS, VERSION, Flag, Kind
from ballbot_rs.link.log import ExchangeLog, check_file
from ballbot_rs.link.statistics import Statistics
from ballbot_rs.link.transports import SCHEMES, check_address, connect

Array = npt.NDArray[np.float64]

ON_TIMEOUT: Final = ("hold", "zero")

#: Why a controller may never answer.
_SILENCE: Final = f": is it running, with frames of version {VERSION}? Re-export older C headers"

#: Time of a call beyond its waiting, s.
GRACE: Final = 1.0

#: Longest times of options, s, and most steps or repetitions.
MAX_SECONDS: Final = 3600.0
MAX_COUNT: Final = 1_000_000


@named
class Link:
    """A controller of one robot in another process or on a board, usable in `simulate` and wherever a law is.

    ```python
    import sys

    peer = f"{sys.executable} -m ballbot_rs link --peer lqr stdio:"
    with bb.Link(f"exec:{peer}") as link:
        print(bb.simulate(link, sensors="exact", seconds=0.2))
    ```

    At each control step it sends the readings of the sensors and the setpoint, and gets torques: docs/link.md has the
    frames. It opens line and log at the first step, and closes them in `close`, at the end of a `with`, or when it is
    collected.

    In lockstep the simulation waits: readings without an answer within `timeout` are sent again, `retries` times. In
    real time a step takes `control_dt` of wall time and torques must arrive within it. Without torques the robot gets
    the last torques for up to `hold` steps (`on_timeout="hold"`), then zero torque; after `give_up` the run ends. The
    first readings of an episode are repeated in either case: without them the controller would not begin the episode.

    Args:
        address: udp://HOST:PORT, serial:/dev/NAME?baud=RATE, or exec:COMMAND for a child process.
        control_dt: time between two calls, s; None is the task's.
        real_time: whether the simulation keeps to the clock instead of waiting for the controller.
        timeout: time until readings are sent again, s; not in real time.
        retries: how many times they are sent again.
        on_timeout: "hold" or "zero".
        hold: maximum number of consecutive steps with the last torques.
        give_up: time of waiting without any torques after which the run ends, s.
        connect: the same for the first torques of an episode, s.
        faults: faults to inject into the line.
        log: a file of the whole exchange, FILE.mcap.

    Raises:
        ValueError: a malformed address, or a number out of range.
        ModuleNotFoundError: a library for the line or the log is missing; the message states what to install.
    """

    name = "link"
    reads_sensors = True

    def __init__(
        self,
        address: str,
        *,
        control_dt: float | None = None,
        real_time: bool = False,
        timeout: float = 0.1,
        retries: int = 3,
        on_timeout: Literal["hold", "zero"] = "hold",
        hold: int = 10,
        give_up: float = 5.0,
        connect: float = 10.0,
        faults: LinkFaults | None = None,
        log: str | PathLike[str] | None = None,
    ) -> None:
        cobs_library()
        check_address(address)
        if on_timeout not in ON_TIMEOUT:
            raise InvalidInputError(f"on_timeout = {on_timeout!r}: expected one of {', '.join(ON_TIMEOUT)}")
        self.address = address
        self.control_dt = None if control_dt is None else check_bounded("control_dt", control_dt, 1e-6, MAX_SECONDS)
        #: Counts and times so far.
        self.statistics = Statistics()
        self._timing = Timing(
            real_time=bool(real_time),
            timeout=check_bounded("timeout", timeout, 1e-6, MAX_SECONDS),
            attempts=1 + _count("retries", retries),
            connect=check_bounded("connect", connect, 0.0, MAX_SECONDS),
        )
        self._hold = _count("hold", hold) if on_timeout == "hold" else 0
        self._give_up = check_bounded("give_up", give_up, 0.0, MAX_SECONDS)
        if not isinstance(faults, (LinkFaults, NoneType)):
            raise InvalidInputError(f"faults = {faults!r}: expected LinkFaults")
        self._faults = faults
        self._log_file = None if log is None else Path(log)
        if self._log_file is not None:
            check_file(self._log_file)
        self._log: ExchangeLog | None = None
        self._exchange: Exchange | None = None
        self._period = self.control_dt or CONTROL_DT
        # Another simulation may have talked to the controller: its numbers are most likely others.
        self._sequence = randbits(32)
        self.reset()

    def resolved(self) -> ResolvedController:
        """The law as `find` returns it: it needs sensors, and learns its period from the robot that it is put on."""

        def begin(_: Any, control_dt: float) -> Link:
            self._period = control_dt
            self.reset()
            return self

        return ResolvedController(
            self.name,
            {"sensors": "exact"},
            make_law=begin,
            existing=self,
            control_dt=self.control_dt,
            max_call=self._timing.longest + GRACE,
        )

    def open(self) -> Self:
        """Opens the line, if it is not open.

        Raises:
            OSError: there is no such port, host or program, or the log cannot be written.
        """
        if self._exchange is None:
            with contextlib.ExitStack() as opened:
                transport = connect(self.address)
                opened.callback(transport.close)
                self._log = None if self._log_file is None else ExchangeLog(self._log_file)
                channel = Channel(transport, Kind.TORQUES, self.statistics, self._faults, self._log)
                self._closing = weakref.finalize(self, _close, channel, self._log, self.statistics)
                opened.pop_all()
            self._exchange = Exchange(channel, self._timing, self.statistics, self._log)
        return self

    def close(self) -> None:
        """Sends STOP and closes the line and the log; a child process ends within a second."""
        if self._exchange is not None:
            self._exchange = None
            self.reset()
            self._closing()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __deepcopy__(self, _: Any) -> NoReturn:
        raise TypeError("a link drives one robot: run one episode at a time")

    def reset(self) -> None:
        """Begins an episode: the next readings have the flag RESET."""
        self._step = 0
        self._last = np.zeros(3)
        self._missed = 0
        if self._exchange is not None:
            self._exchange.reset()

    def __call__(self, readings: Mapping[str, Array], setpoint: Setpoint) -> Array:
        """Torques for the next control step, shape (3,), N·m.

        Args:
            readings: as `Batch.readings(0)`.
            setpoint: what the controller is to follow.

        Raises:
            TimeoutError: no torques for longer than `give_up`, or at the start of an episode `connect`.
            ConnectionError: the other side is gone for good, such as a child process that has ended, or it has
                frames of another version.
            OSError: the line cannot be opened.
        """
        exchange = self.open()._exchange
        assert exchange is not None
        parts: dict[str, Any] = {**setpoint, **readings}
        numbers = np.concatenate([np.atleast_1d(parts[field.name]) for field in READINGS])
        self._sequence = (self._sequence + 1) % WRAP
        flags = Flag.RESET if self._step == 0 else Flag(0)
        time_of_step = round(1e6 * self._period * self._step) % WRAP
        self.statistics.steps += 1
        frame = Frame(Kind.READINGS, int(flags), self._sequence, time_of_step, tuple(numbers.tolist()))
        answer = exchange.ask(frame, self._period)
        torques = self._without(frame, exchange.silence) if answer is None else self._torques_of(answer)
        self._step += 1
        return torques

    def _torques_of(self, answer: Frame) -> Array:
        self.statistics.answered += 1
        self.statistics.count_status(answer.flags & 0xFF)
        self._missed = 0
        self._last = np.array(answer.numbers)
        return self._last

    def _without(self, frame: Frame, silence: float) -> Array:
        """What the robot gets without an answer, s after the last."""
        statistics = self.statistics
        self._missed += 1
        if frame.flags & Flag.RESET or silence >= self._give_up:
            raise TimeoutError(
                f"no torques from {self.address} for {silence:.2g} s and {self._missed} steps "
                f"({statistics.answered} of {statistics.steps} steps were answered, {statistics.corrupted} frames were "
                f"corrupted){'' if statistics.answered else _SILENCE}"
            )
        is_held = self._missed <= self._hold
        statistics.count("held" if is_held else "zeroed")
        if self._log is not None:
            self._log.missed(frame, "held" if is_held else "zeroed")
        return self._last if is_held else np.zeros(3)


def _count(name: str, value: int) -> int:
    """The value as an int. Raises ValueError or TypeError unless it is a whole number within the bounds."""
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} = {value!r} is not a whole number") from None
    if not 0 <= count <= MAX_COUNT:
        raise InvalidInputError(f"{name} = {value} is out of range: expected 0 to {MAX_COUNT}")
    return count


def _close(channel: Channel, log: ExchangeLog | None, statistics: Statistics) -> None:
    zeros = (0.0,) * sum(field.length for field in READINGS)
    try:
        channel.close(Frame(Kind.READINGS, int(Flag.STOP), 0, 0, zeros))
    finally:
        if log is not None:
            log.close(statistics)


resolve.SCHEMES.update(dict.fromkeys(SCHEMES, Link))
