"""The largest tilts and pushes from which a controller recovers."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ballbot_rs.control.resolve import Source
from ballbot_rs.scenarios.run import run_scenarios
from validation.page import table

#: Maps of the tilt and of pushes, in 24 directions.
SCENARIOS: Final = ("S2-rest", "S3-at-once", "S3-slow")

Array = npt.NDArray[np.float64]


class Stood(NamedTuple):
    """Disturbance limits of a controller, in each direction."""

    #: deg.
    tilt: Array
    #: N·s.
    at_once: Array
    slow: Array


def measure(controller: Source) -> Stood:
    """The basin, and pushes, instantaneous and over 0.1 s."""
    return Stood(*(outcome.largest for outcome in run_scenarios(controller, SCENARIOS)))


def side_by_side(what: str, stood: Mapping[str, Stood]) -> str:
    """A table of the worst and the mean over all directions."""
    head = [what]
    for column in ("tilt, worst (deg)", "push at once, worst (N·s)", "push in 0.1 s, worst (N·s)"):
        head += [column, "mean"]
    rows = [
        [name, *(f"{value:.2f}" for of in found for value in (of.min(), of.mean()))] for name, found in stood.items()
    ]
    return table(head, rows)
