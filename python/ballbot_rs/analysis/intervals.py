"""Confidence intervals over episodes."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

#: Two-sided quantile of the normal distribution at 95 %.
_Z: Final = 1.959964

#: Resamples of a bootstrap.
_RESAMPLES: Final = 2000


def of_share(share: float, count: int) -> tuple[float, float]:
    """Wilson 95 % interval of a fraction of `count` episodes."""
    center = (share + _Z * _Z / (2 * count)) / (1 + _Z * _Z / count)
    half = _Z / (1 + _Z * _Z / count) * math.sqrt(share * (1 - share) / count + _Z * _Z / (4 * count * count))
    return max(center - half, 0.0), min(center + half, 1.0)


def of_mean(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the mean by bootstrap over episodes, shape (n,), n ≥ 2; the same in every call."""
    rng, n = np.random.default_rng(0), len(values)
    # One resample at a time: all of them may not fit into memory.
    means = [values[rng.integers(n, size=n)].mean() for _ in range(_RESAMPLES)]
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)
