"""Numbers that a page asks for."""

import numpy as np


def check_bounded(name: str, value: float, low: float, high: float) -> float:
    """The value as a float. Raises ValueError unless it is a number within the bounds."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        raise ValueError(f"{name} = {value!r}: expected a number")
    if not low <= value <= high:
        raise ValueError(f"{name} = {value} is out of range: expected {low:g} to {high:g}")
    return float(value)
