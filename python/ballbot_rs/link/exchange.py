"""Readings that are sent and the torques that answer them, in lockstep or by the clock."""

import dataclasses
import math
import time

from ballbot_rs.link.channel import Channel
from ballbot_rs.link.frames import Frame
from ballbot_rs.link.layout import Flag
from ballbot_rs.link.log import ExchangeLog
from ballbot_rs.link.statistics import Statistics


@dataclasses.dataclass(frozen=True)
class Timing:
    """When readings are sent, and how long their answers may take; docs/link.md has both modes."""

    #: Whether each step takes its time of the clock.
    real_time: bool
    #: Time until readings are sent again, s; not in real time.
    timeout: float
    #: How often they are sent.
    attempts: int
    #: Time of waiting for the first answer of an episode, s.
    connect: float

    @property
    def longest(self) -> float:
        """Time of a step in lockstep, at most, s."""
        return self.connect + self.attempts * self.timeout


class Exchange:
    """The simulation's side of a line that is open.

    Args:
        channel: the line.
        timing: when it sends and waits.
        statistics: where it counts.
        log: gets all frames.
    """

    def __init__(
        self, channel: Channel, timing: Timing, statistics: Statistics, log: ExchangeLog | None = None
    ) -> None:
        self._channel, self._timing, self._statistics, self._log = channel, timing, statistics, log
        self._answered: int | None = None
        self.reset()

    def reset(self) -> None:
        """Begins an episode."""
        self._due: float | None = None
        #: Time of waiting since the last answer, s.
        self.silence = 0.0

    def ask(self, frame: Frame, period: float) -> Frame | None:
        """Sends readings and returns their answer; None without an answer in time. A step takes `period`, s."""
        timing = self._timing
        begins = self._begin_step(period)
        if frame.flags & Flag.RESET:
            # Whatever the line loses, each episode begins with it.
            answer = self._repeat(frame, begins + timing.connect, timing.timeout)
        elif self._due is not None:
            answer = self._repeat(frame, self._due + period, math.inf)
        else:
            answer = self._repeat(frame, begins + timing.attempts * timing.timeout, timing.timeout)
        now = time.perf_counter()
        if answer is None:
            self.silence += now - begins
            return None
        if not frame.flags & Flag.RESET:
            # The first answer has the start of the controller in it.
            self._statistics.round_trips.append(now - begins)
        elif self._due is not None:
            # So the clock begins with it.
            self._due = now
        self._answered, self.silence = answer.sequence, 0.0
        return answer

    def _begin_step(self, period: float) -> float:
        """Waits for the time of the step, in real time; returns the time."""
        if not self._timing.real_time:
            return time.perf_counter()
        if self._due is None:
            self._due = time.perf_counter()
            return self._due
        self._due += period
        while time.perf_counter() < self._due:
            self._receive(None, self._due)
        begins = time.perf_counter()
        self._statistics.delays.append(begins - self._due)
        if begins > self._due + period:
            # The simulation itself was too slow: what is missed is not made up for.
            self._statistics.overruns += 1
            self._due = begins
        return begins

    def _repeat(self, frame: Frame, ends: float, timeout: float) -> Frame | None:
        """Sends readings, and again after each timeout, until their answer or a time."""
        repetitions = 0
        while True:
            if self._log is not None:
                self._log.sent(frame, repetitions)
            self._channel.send(frame)
            answer = self._receive(frame.sequence, min(ends, time.perf_counter() + timeout))
            if answer is not None or time.perf_counter() >= ends:
                return answer
            repetitions += 1
            self._statistics.repeated += 1

    def _receive(self, sequence: int | None, deadline: float) -> Frame | None:
        """The answer to the readings of a number, None at the deadline; other answers are counted and ignored."""
        while (answer := self._channel.receive(deadline)) is not None:
            fate = self._fate(answer, sequence)
            if self._log is not None:
                self._log.received(answer, fate)
            if fate == "accepted":
                return answer
            self._statistics.count(fate)
            if time.perf_counter() >= deadline:
                break
        return None

    def _fate(self, answer: Frame, sequence: int | None) -> str:
        if answer.sequence == sequence:
            return "accepted"
        return "duplicated" if answer.sequence == self._answered else "late"
