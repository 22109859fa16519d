"""Settling times."""

import numpy as np
import numpy.typing as npt


def settling_times(deviations: npt.ArrayLike, limit: float, control_dt: float) -> npt.NDArray[np.float64]:
    """Times from which series stay within a limit, s; infinite where the last value is outside.

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
