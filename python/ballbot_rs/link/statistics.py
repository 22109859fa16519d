"""What a link counts and measures, as text and as JSON."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ballbot_rs.link.layout import Status

#: Percentiles of times.
_PERCENTILES: Final = (50, 90, 99)

_STATUSES: Final[dict[int, str]] = {status: status.name.lower() for status in Status}

#: Most intervals and columns of a histogram.
_INTERVALS: Final = 12
_COLUMNS: Final = 40


@dataclasses.dataclass
class Statistics:
    """Counts of frames and steps of a link, and its times."""

    #: Control steps of the simulation.
    steps: int = 0
    #: Steps with torques of the controller in time.
    answered: int = 0
    #: Steps without: the robot got the last torques, or none.
    held: int = 0
    zeroed: int = 0
    #: In real time: steps that began a whole step late, as the simulation was too slow.
    overruns: int = 0
    #: Readings that were sent again.
    repeated: int = 0
    #: Frames that the system did not take, as nobody reads them.
    unsent: int = 0
    #: Torques for readings of the past: too late, or again.
    late: int = 0
    duplicated: int = 0
    #: Readings of a simulation other than the one that the peer answers.
    foreign: int = 0
    #: Bytes between two zeros that are not a frame, frames with a wrong checksum, frames of another version or kind.
    broken: int = 0
    corrupted: int = 0
    unknown: int = 0
    #: Answers by status.
    statuses: dict[str, int] = dataclasses.field(default_factory=dict)
    #: From readings to the torques that answer them, s.
    round_trips: list[float] = dataclasses.field(default_factory=list)
    #: In real time: how much later than scheduled readings were sent, s.
    delays: list[float] = dataclasses.field(default_factory=list)

    def count(self, name: str) -> None:
        """Adds one to a count."""
        setattr(self, name, getattr(self, name) + 1)

    def count_status(self, code: int) -> None:
        """Adds an answer with a status."""
        name = _STATUSES.get(code, f"status {code}")
        self.statuses[name] = self.statuses.get(name, 0) + 1

    def report(self) -> dict[str, Any]:
        """All of it for JSON; times in s."""
        counts = {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.name not in ("round_trips", "delays")
        }
        return {**counts, "round_trip": _summary(self.round_trips), "jitter": _summary(self.delays)}

    def text(self) -> str:
        """Lines for a terminal: the counts that are not zero, and a histogram of each time."""
        lines = [f"{self.answered} of {self.steps} steps answered in time"]
        names = (
            "held",
            "zeroed",
            "overruns",
            "repeated",
            "unsent",
            "late",
            "duplicated",
            "foreign",
            "broken",
            "corrupted",
            "unknown",
        )
        counts = {name: getattr(self, name) for name in names}
        counts |= {name.replace("_", " "): count for name, count in self.statuses.items() if name != "running"}
        if any(counts.values()):
            lines.append(", ".join(f"{count} {name}" for name, count in counts.items() if count))
        for title, seconds in (("round trip", self.round_trips), ("jitter of the readings", self.delays)):
            if seconds:
                lines += ["", *_histogram(title, seconds)]
        return "\n".join(lines)


def _summary(seconds: Sequence[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    values = np.percentile(seconds, _PERCENTILES)
    of = {f"p{percent}": float(value) for percent, value in zip(_PERCENTILES, values, strict=True)}
    return {"mean": float(np.mean(seconds)), **of, "worst": float(np.max(seconds))}


def _histogram(title: str, seconds: Sequence[float]) -> list[str]:
    """A bar for each interval; intervals are powers of two of a microsecond, so that rare long times show."""
    found = _summary(seconds)
    assert found is not None
    micros = 1e6 * np.asarray(seconds)
    powers = np.clip(np.ceil(np.log2(np.maximum(micros, 1.0))), 0, 62).astype(int)
    first = max(int(powers.min()), int(powers.max()) - _INTERVALS + 1)
    counts = np.bincount(np.maximum(powers, first) - first)
    lines = [f"{title}: median {_time(found['p50'])}, 99 % {_time(found['p99'])}, worst {_time(found['worst'])}"]
    for power, count in enumerate(counts.tolist(), first):
        bar = "#" * -(-_COLUMNS * count // max(counts.tolist()))
        lines.append(f"  up to {_time(2.0**power * 1e-6):>8}  {count:>8}  {bar}".rstrip())
    return lines


def _time(seconds: float) -> str:
    if seconds < 1e-3:
        return f"{1e6 * seconds:.0f} µs"
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
