"""The controller's side of a link in Python, to try a controller before there is a board."""

import time
from typing import Any, Final

import numpy as np

from ballbot_rs._checks import check_bounded
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs.control.laws import Law, Laws, is_batched, reads_sensors
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.link.channel import Channel
from ballbot_rs.link.frames import WRAP, Frame, cobs_library
from ballbot_rs.link.layout import LATE, READINGS, Field, Flag, Kind, Status
from ballbot_rs.link.statistics import Statistics
from ballbot_rs.link.streams import ClosedError
from ballbot_rs.link.transports import listen

#: Longest time without readings, s.
MAX_IDLE: Final = 86_400.0

#: Time without readings after which another simulation may take its place, s.
PAUSE: Final = 1.0

#: Of a supervised law that has tripped, by its own status.
_TRIPPED: Final = {
    "tilt": Status.LIMIT,
    "speed": Status.LIMIT,
    "stale": Status.STALE,
    "not_finite": Status.NOT_FINITE,
}

_READINGS: Final = ("gyro", "specific_force", "wheel_angles")


@named
class LinkPeer:
    """Answers the readings of a simulation with the torques of a law that reads sensors.

    ```python
    import threading

    law = bb.EstimatedController("lqr", "kugle", sensors="kugle")
    peer = bb.LinkPeer(law, "udp://127.0.0.1:9471")
    threading.Thread(target=peer.serve).start()  # usually in another process
    with bb.Link("udp://127.0.0.1:9471") as link:
        print(bb.simulate(link, robot="kugle", sensors="kugle", seconds=0.2))
    ```

    Readings that it has answered already get the same answer, without another call of the law; late readings get none.
    The status is of a law that is `Supervised`, with the torques that it ramps down, else `running`.
    Before the first RESET it is `starting`, and for readings that are not finite `not_finite`, both with zero
    torque. Over UDP it answers one simulation: from its RESET until STOP, or until it pauses for `PAUSE` and another
    begins an episode.

    Args:
        law: called with readings (`gyro`, `specific_force`, `wheel_angles`) and, if it takes one, a setpoint, as in
            `simulate`; its `reset` is called at each RESET.
        address: udp://HOST:PORT to listen on, serial:/dev/NAME?baud=RATE, or stdio: for a child process.
        idle: time without readings after which `serve` ends, s.

    Raises:
        ValueError: not such a law, a malformed address, or a number out of range.
        OSError: there is no such port, or another program has it.
    """

    def __init__(self, law: Law, address: str, *, idle: float = 600.0) -> None:
        cobs_library()
        if isinstance(law, type) or not callable(law) or not reads_sensors(law) or is_batched(law):
            raise InvalidInputError(
                f"{law!r} is not a law of one robot that reads sensors: expected an object, not a class, with "
                "reads_sensors = True"
            )
        self._idle = check_bounded("idle", idle, 0.0, MAX_IDLE)
        # The simulation limits the torques.
        self._laws = Laws(getattr(law, "name", type(law).__name__), lambda: law, 1, np.inf, is_made=False)
        self._period: float | None = getattr(law, "control_dt", None)
        #: Counts of frames.
        self.statistics = Statistics()
        self._channel: Channel | None = Channel(listen(address), Kind.READINGS, self.statistics)
        self._sender: Any = None
        self._heard = 0.0
        self._last: Frame | None = None
        self._answer: Frame | None = None
        self._has_begun = False

    def serve(self) -> None:
        """Answers until the simulation stops, its side is closed, or there were no readings for `idle`.

        Raises:
            TimeoutError: there were no readings for `idle`.
            ControllerError: the law failed.
            ValueError: the `control_dt` of the law differs from the simulation's, or the peer has already served.
            ConnectionError: the simulation has frames of another version.
        """
        channel, self._channel = self._channel, None
        if channel is None:
            raise InvalidInputError("a peer serves once: make another LinkPeer")
        try:
            while (readings := channel.receive(time.perf_counter() + self._idle)) is not None:
                if self._is_foreign(readings, channel.sender):
                    self.statistics.foreign += 1
                    continue
                if readings.flags & Flag.STOP:
                    return
                answer = self._answer_to(readings)
                # Others cannot end a simulation.
                channel.allows_versions = self._has_begun
                if answer is not None:
                    channel.send(answer)
            raise TimeoutError(f"no readings for {self._idle:g} s")
        except ClosedError:
            pass
        finally:
            channel.close()

    def _is_foreign(self, readings: Frame, sender: Any) -> bool:
        """Whether readings are of another simulation than the one that it answers."""
        now = time.perf_counter()
        is_reset = bool(readings.flags & Flag.RESET)
        if sender != self._sender:
            if self._sender is not None and not (is_reset and now - self._heard > PAUSE):
                return True
            if is_reset:
                self._sender, self._last, self._answer = sender, None, None
        self._heard = now
        return False

    def _answer_to(self, readings: Frame) -> Frame | None:
        if self._last is not None:
            steps = (readings.sequence - self._last.sequence) % WRAP
            if steps == 0:
                self.statistics.repeated += 1
                return self._answer
            if steps >= WRAP - (LATE if readings.flags & Flag.RESET else WRAP // 2):
                self.statistics.late += 1
                return None
            if steps == 1 and not readings.flags & Flag.RESET:
                self._check_period((readings.time - self._last.time) % WRAP)
        status, torques = self._step(readings)
        self._last = readings
        self._answer = Frame(Kind.TORQUES, int(status), readings.sequence, readings.time, torques)
        return self._answer

    def _check_period(self, microseconds: int) -> None:
        """Raises ValueError if the law was made for another time between two calls."""
        if self._period is not None and abs(microseconds - 1e6 * self._period) > 1.0:
            raise InvalidInputError(
                f"the simulation has control_dt = {1e-6 * microseconds:g} s, but {self._laws.name} is made for "
                f"{self._period:g} s"
            )

    def _step(self, readings: Frame) -> tuple[Status, tuple[float, ...]]:
        zero = (0.0, 0.0, 0.0)
        if readings.flags & Flag.RESET:
            self._laws.reset(np.ones(1, dtype=bool))
            self._has_begun = True
        if not self._has_begun:
            return Status.STARTING, zero
        if not np.isfinite(readings.numbers).all():
            return Status.NOT_FINITE, zero
        parts = _parts(readings)
        read: Any = {name: parts.pop(name) for name in _READINGS}
        torques = self._laws.torques([read], [Setpoint(**parts)])[0]
        status = _TRIPPED.get(getattr(self._laws.first, "status", ""), Status.RUNNING)
        return status, tuple(torques.tolist())


def _parts(readings: Frame) -> dict[str, Any]:
    """The numbers by field."""
    left = np.array(readings.numbers)
    parts: dict[str, Any] = {}
    for field in READINGS:
        parts[field.name], left = _part(field, left), left[field.length :]
    return parts


def _part(field: Field, numbers: Any) -> Any:
    return float(numbers[0]) if field.length == 1 else numbers[: field.length]
