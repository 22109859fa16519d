"""A scenario under a controller."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import keep_copies
from ballbot_rs.analysis import intervals
from ballbot_rs.scenarios.metrics import METRICS
from ballbot_rs.scenarios.scenario import Scenario

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, repr=False)
class Outcome:
    """A scenario under a controller; its arrays are read-only.

    ```python
    (outcome,) = bb.run_scenarios("lqr", "S13-6s")
    print(outcome.scenario.title, outcome.score, outcome.row())
    ```
    """

    controller: str
    scenario: Scenario
    #: Numbers of each episode by name (`metrics.METRICS`), shape (n,).
    metrics: Mapping[str, Array]
    #: Which episodes are a success, shape (n,).
    success: npt.NDArray[np.bool_]
    #: For a map, the largest number up to which all succeed, in each direction, shape (directions,); else empty.
    largest: Array
    #: Why no episode was run; None if episodes were run.
    skipped: str | None = None

    def __post_init__(self) -> None:
        keep_copies(self)

    def __repr__(self) -> str:
        if self.skipped is not None:
            return f"<Outcome of {self.controller} in {self.scenario.id}: skipped, {self.skipped}>"
        successes = f"{int(self.success.sum())} of {len(self.success)} successes"
        score = "largest" if self.scenario.is_map else self.scenario.score
        return f"<Outcome of {self.controller} in {self.scenario.id}: {score} {self.score:.4g}, {successes}>"

    @property
    def _fell(self) -> npt.NDArray[np.bool_]:
        return self.metrics["fell"].astype(bool)

    @property
    def score(self) -> float:
        """The number by which controllers are compared; not finite if a robot fell, NaN if it was skipped.

        The worst direction of a map, the worst episode of several directions, the mean of the worse half of random
        episodes (CVaR 0.5).
        """
        if self.skipped is not None:
            return math.nan
        if self.scenario.is_map:
            return float(self.largest.min())
        if self.scenario.score == "success":
            return float(self.success.mean())
        values = np.where(self._fell, np.inf, self.metrics[self.scenario.score])
        if self.scenario.seeds == 1:
            return float(values.max())
        if not np.isfinite(values).all():
            return math.inf
        return float(np.sort(values)[len(values) // 2 :].mean())

    @property
    def higher_is_better(self) -> bool:
        """Whether a larger score is better: largest tilts and pushes, success rates."""
        return self.scenario.is_map or self.scenario.score == "success"

    @property
    def success_rate(self) -> float:
        """Fraction of the episodes that are a success; NaN without episodes."""
        return float(self.success.mean()) if len(self.success) else math.nan

    def interval(self) -> tuple[float, float]:
        """Wilson 95 % interval of the success rate; NaN without episodes."""
        if not len(self.success):
            return (math.nan, math.nan)
        return intervals.of_share(self.success_rate, len(self.success))

    def row(self) -> dict[str, Any]:
        """One row for a table or JSON: means over the episodes that did not fall, largest numbers, successes.

        None means no number: the score where a robot fell, a mean over no episode, or over an episode that never
        settled. `skipped`, present if no episode was run, has the reason.
        """
        stood = ~self._fell
        means = {
            name: float(np.mean(self.metrics[name][stood])) if stood.any() else math.nan
            for name in METRICS
            if name != "fell"
        }
        return {
            "controller": self.controller,
            "scenario": self.scenario.id,
            "score": _finite(self.score),
            "success_rate": _finite(self.success_rate),
            "success_interval": [_finite(bound) for bound in self.interval()],
            "episodes": len(self.success),
            "falls": int((~stood).sum()),
            **({"largest": self.largest.tolist()} if self.scenario.is_map else {}),
            **{name: _finite(value) for name, value in means.items()},
            **({} if self.skipped is None else {"skipped": self.skipped}),
        }


def _finite(value: float) -> float | None:
    """None in place of numbers that JSON does not have."""
    return value if math.isfinite(value) else None
