"""Faults of a line on purpose: frames lost, damaged, repeated and delayed at given rates."""

import dataclasses

import numpy as np

from ballbot_rs._checks import check_bounded, check_seed
from ballbot_rs._keywords import named

#: Longest delay of a frame, s.
MAX_DELAY = 10.0


@named
@dataclasses.dataclass(frozen=True)
class LinkFaults:
    """Probabilities of injected faults per frame, in each direction, independent of each other.

    ```python
    faults = bb.LinkFaults(drop=0.05, corrupt=0.01, seed=1)
    link = bb.Link("udp://127.0.0.1:9471", faults=faults)  # opened by the first step of a simulation
    ```

    Raises:
        ValueError: a probability that is not within 0 and 1, or a delay that is not within 0 and `MAX_DELAY`.
    """

    #: It is lost.
    drop: float = 0.0
    #: One of its bits is flipped.
    corrupt: float = 0.0
    #: It arrives twice.
    duplicate: float = 0.0
    #: It arrives later by `delay_time`, after frames that were sent since.
    delay: float = 0.0
    #: s.
    delay_time: float = 0.02
    #: Of the random numbers.
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("drop", "corrupt", "duplicate", "delay"):
            check_bounded(name, getattr(self, name), 0.0, 1.0)
        check_bounded("delay_time", self.delay_time, 0.0, MAX_DELAY)
        check_seed(self.seed)

    @property
    def are_none(self) -> bool:
        """Whether the line is perfect."""
        return not (self.drop or self.corrupt or self.duplicate or self.delay)


class FaultyLine:
    """One direction of a line with faults."""

    def __init__(self, faults: LinkFaults, direction: int) -> None:
        self._faults = faults
        self._random = np.random.default_rng([faults.seed, direction])

    def passed(self, stuffed: bytes) -> list[tuple[float, bytes]]:
        """What becomes of a frame: its copies, each with the delay after which it arrives, s."""
        faults = self._faults
        if faults.are_none:
            return [(0.0, stuffed)]
        # The same random numbers whatever the probabilities.
        dropped, corrupted, repeated, delayed = self._random.random(4) < (
            faults.drop,
            faults.corrupt,
            faults.duplicate,
            faults.delay,
        )
        bit = int(self._random.integers(8 * len(stuffed)))
        if dropped:
            return []
        if corrupted:
            stuffed = _flipped(stuffed, bit)
        return [(faults.delay_time if delayed else 0.0, stuffed)] * (2 if repeated else 1)


def _flipped(stuffed: bytes, bit: int) -> bytes:
    changed = bytearray(stuffed)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
