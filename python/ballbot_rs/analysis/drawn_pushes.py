"""Pushes that events and tasks have sampled, read from the draws of a simulation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs.analysis.pushes import Push

Array = npt.NDArray[np.float64]

#: Name of the terms; the id of a term, if it has one, follows a colon.
TERM = "push"


def is_push(term: str) -> bool:
    """Whether a term of draws is a push."""
    return term == TERM or term.startswith(f"{TERM}:")


def drawn_pushes(
    draws: Mapping[str, Array], times: Array, events: Sequence[Mapping[str, Any]], body_mass: float
) -> tuple[Push, ...]:
    """The pushes, ordered by time.

    A push with exactly the numbers of the push before it, as from events without a range, is taken for the same push.

    Args:
        draws: of each row, by term, as `Batch.draws`.
        times: of the rows, s.
        events: as `Batch.options["events"]` has them.
        body_mass: of the robot without events, kg; pushes with `op = "scale"` are multiples of it.
    """
    scaled = {_name(event) for event in events if event.get("op") == "scale"}
    found = []
    for term, rows in draws.items():
        if not is_push(term):
            continue
        changed = np.any((rows[1:] != rows[:-1]) & ~(np.isnan(rows[1:]) & np.isnan(rows[:-1])), axis=1)
        for row in np.flatnonzero(changed & ~np.isnan(rows[1:, 0])):
            size, azimuth, height = rows[row + 1].tolist()
            size *= body_mass if term in scaled else 1.0
            impulse = (size * float(np.cos(azimuth)), size * float(np.sin(azimuth)), 0.0)
            point = None if np.isnan(height) else (0.0, 0.0, height)
            found.append(Push(impulse, time=float(times[row]), point=point))
    return tuple(sorted(found, key=lambda push: push.time))


def _name(event: Mapping[str, Any]) -> str:
    return str(event["term"]) if "id" not in event else f"{event['term']}:{event['id']}"
