"""Bisection for the threshold at which a predicate becomes false."""

from collections.abc import Callable


def largest(holds: Callable[[float], bool], low: float, high: float, to: float = 1e-9) -> float:
    """The largest value between `low`, where it holds, and `high`, where it does not, by bisection to within `to`."""
    if not holds(low) or holds(high):
        raise ValueError(f"holds({low}) must be true and holds({high}) false")
    while high - low > to:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
