"""Settling and recovery times."""

from typing import Final

import numpy as np
import numpy.typing as npt

#: Time for which a robot must stay within its limits to have recovered, s.
HOLD: Final = 1.0


def settling_times(deviations: npt.ArrayLike, limit: float, control_dt: float) -> npt.NDArray[np.float64]:
    """Times from which series stay within a limit, s; infinite where the last value is outside it.

    Args:
        deviations: rows `control_dt` apart, the first at time zero: shape (steps,) or (steps, n). NaN counts as inside.
        limit: largest absolute value that is inside.
        control_dt: time between two rows, s.

    Returns:
        Shape () or (n,).
    """
    outside = np.abs(np.asarray(deviations, dtype=np.float64)) > limit
    after_last = len(outside) - np.argmax(outside[::-1], axis=0)
    rows = np.where(outside.any(axis=0), after_last, 0)
    return np.where(rows < len(outside), rows * control_dt, np.inf)


def recovery_times(deviations: npt.ArrayLike, limit: float, control_dt: float) -> npt.NDArray[np.float64]:
    """Settling times, infinite where the series has been within the limit for less than the last `HOLD` seconds."""
    times = settling_times(deviations, limit, control_dt)
    return np.where(times <= len(np.asarray(deviations)) * control_dt - HOLD + 1e-9, times, np.inf)


def push_recovery_times(
    outside: npt.NDArray[np.bool_], pushed: npt.NDArray[np.bool_], fell: bool, control_dt: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Times from pushes until robots are back within limits and stay there, up to the next push or the end.

    Args:
        outside: whether a robot is outside of its limits before each control step, shape (steps,).
        pushed: whether it is pushed at the beginning of the step, shape (steps,).
        fell: whether the series ends in a fall.
        control_dt: duration of a control step, s.

    Returns:
        A time per push, s, infinite before a fall; and whether it is known: after less than `HOLD` seconds within the
        limits it is only a lower bound.
    """
    first = np.flatnonzero(pushed)
    times, known = np.full(len(first), np.inf), np.ones(len(first), dtype=np.bool_)
    ends = np.append(first[1:], len(outside) - 1)[: len(first)]
    for i, (begin, end) in enumerate(zip(first.tolist(), ends.tolist(), strict=True)):
        if fell and i == len(first) - 1:
            break
        # The state before the step of the push is not an effect of it.
        span = outside[begin : end + 1].copy()
        span[0] = False
        back = len(span) - int(np.argmax(span[::-1])) if span.any() else 0
        times[i] = back * control_dt
        known[i] = (len(span) - max(back, 1)) * control_dt >= HOLD - 1e-9
    return times, known


def censored_median(times: npt.NDArray[np.float64], known: npt.NDArray[np.bool_]) -> float:
    """Kaplan-Meier median of times of which some are only lower bounds; infinite if half are."""
    left = 1.0
    for time in np.unique(times[known & np.isfinite(times)]):
        left *= 1.0 - (known & (times == time)).sum() / (times >= time).sum()
        if left <= 0.5:
            return float(time)
    return np.inf
