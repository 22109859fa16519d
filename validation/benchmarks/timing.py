"""Rates measured in interleaved rounds, so that disturbances of the machine affect every simulator alike."""

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

#: Advances everything by one call; returns the number of steps and their duration, s.
Run = Callable[[], tuple[int, float]]


def timed(step: Callable[[], Any], steps: int, before: Callable[[], Any] | None = None) -> Run:
    """A run of a call that makes `steps` steps; the time of `before`, which is called first, does not count."""

    def run() -> tuple[int, float]:
        if before is not None:
            before()
        start = time.perf_counter()
        step()
        return steps, time.perf_counter() - start

    return run


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
    steps, elapsed = 0, 0.0
    while elapsed < seconds:
        made, took = run()
        steps, elapsed = steps + made, elapsed + took
    return steps / elapsed


def interleave(runs: Mapping[str, Run], rounds: int, seconds: float) -> dict[str, Rate]:
    """Rate of each run over `rounds` rounds of about `seconds` each, after a warm-up round of a third."""
    found: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        _round(run, seconds / 3.0)
    for _ in range(rounds):
        for name, run in runs.items():
            found[name].append(_round(run, seconds))
    return {name: Rate(statistics.median(r), min(r), max(r), r) for name, r in found.items()}
