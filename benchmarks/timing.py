"""Rates measured in interleaved rounds, so that what disturbs the machine disturbs every simulator alike."""

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

#: Advances everything by one call and returns how many steps that were.
Run = Callable[[], int]


@dataclasses.dataclass(frozen=True)
class Rate:
    """Steps per second: median, extremes and all rounds."""

    median: float
    min: float
    max: float
    rounds: list[float]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return dataclasses.asdict(self)


def _round(run: Run, seconds: float) -> float:
    """Steps per second over calls that take about `seconds`, at least one."""
    steps, start = 0, time.perf_counter()
    while True:
        steps += run()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            return steps / elapsed


def interleave(runs: Mapping[str, Run], rounds: int, seconds: float) -> dict[str, Rate]:
    """Rate of each run over `rounds` rounds of about `seconds` each, after one of a third as warm-up."""
    found: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        _round(run, seconds / 3.0)
    for _ in range(rounds):
        for name, run in runs.items():
            found[name].append(_round(run, seconds))
    return {name: Rate(statistics.median(r), min(r), max(r), r) for name, r in found.items()}
