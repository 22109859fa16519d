"""Offset and drift between the clocks of IMU and encoders, from the motion that both measure.

At the frequencies of an excited robot, changes of the body's rates are a linear function of changes of the wheels'
speeds: both follow from the same torques, and gravity changes amplitudes but no phases. The function is fitted at
each lag, so neither the robot's parameters nor the signs of columns are needed; the offset is the lag at which it
is most likely, with Gaussian residuals of unknown size for each axis.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._extras import require
from ballbot_rs.identification.logs.recording import MAX_GAP, Series

Array = npt.NDArray[np.float64]

#: Largest offset that is searched, s.
MAX_LAG: Final = 0.25
#: Least explained fraction of the gyroscope's changes.
LEAST_EXPLAINED: Final = 0.5
#: Moving averages over this time are subtracted, s: slower changes are of gravity and friction.
SLOW: Final = 0.5
#: Blocks whose separate offsets give the standard error, and the shortest, s.
BLOCKS: Final = 16
SHORTEST: Final = 1.0
#: Longest block that a drift may blur, and the shortest time in which a drift is estimated, s.
LONGEST: Final = 10.0
DRIFTS: Final = 20.0
#: Standard errors beyond which an offset or a drift is removed.
SIGNIFICANT: Final = 3.0
#: Standard error that the parts of a log have in common, in samples: from friction, and the motion between samples.
SYSTEMATIC: Final = 0.01
#: Shortest time between samples of a search, s: lags are found to fractions of it.
LEAST_STEP: Final = 1e-3
#: Lags per sample in the refined search.
FINE: Final = 10
#: Most samples of a search: a longer log is searched at its beginning.
MAX_SAMPLES: Final = 100_000


@dataclasses.dataclass(frozen=True)
class Offset:
    """Time of the IMU's clock minus time of the encoders' clock, at `time`, and its growth."""

    #: s.
    value: float
    #: Standard error, s.
    error: float
    #: Fraction of the gyroscope's changes that the encoders explain at the offset.
    explained: float
    #: Of the encoders' clock: the middle of the search, s.
    time: float
    #: Growth of the offset, s/s, and its standard error; 0 and infinite in a log that is too short.
    drift: float = 0.0
    drift_error: float = float("inf")


def estimated(gyro: Series, wheel_angles: Series) -> Offset | None:
    """The offset and its drift; None if the motion does not determine the offset.

    Raises:
        ModuleNotFoundError: SciPy is missing.
    """
    found = _constant(gyro, wheel_angles)
    if found is None or abs(found.drift) <= SIGNIFICANT * found.drift_error:
        return found
    # Blocks are sharper without the drift, which is then the sum of both.
    straight = dataclasses.replace(gyro, time=gyro.time - found.drift * (gyro.time - found.time))
    again = _constant(straight, wheel_angles)
    if again is None:
        return found
    moved = again.value + found.drift * (again.time - found.time)
    return dataclasses.replace(again, value=moved, drift=found.drift + again.drift)


def _constant(gyro: Series, wheel_angles: Series) -> Offset | None:
    """The offset if it is constant, and the drift of the offsets of blocks."""
    step = max(gyro.step, wheel_angles.step, LEAST_STEP)
    first = max(gyro.time[0], wheel_angles.time[0]) + MAX_LAG + 2.0 * step
    last = min(gyro.time[-1], wheel_angles.time[-1]) - MAX_LAG - 2.0 * step
    times = first + step * np.arange(min(max(int((last - first) / step), 0), MAX_SAMPLES))
    seconds = step * len(times)
    blocks = min(max(BLOCKS, int(seconds / LONGEST)), int(seconds / SHORTEST))
    if blocks < 2:
        return None
    # Both as mean rates over four steps: equal filters do not shift them against each other.
    integral = _smooth(gyro).antiderivative()
    angles = _smooth(wheel_angles)

    def changes(of: Any, at: Array) -> Array:
        inside = [np.clip(at + side, of.x[0], of.x[-1]) for side in (2.0 * step, -2.0 * step)]
        return fast((of(inside[0]) - of(inside[1])) / (4.0 * step), step)

    speeds = changes(angles, times)
    usable = near(wheel_angles.time, times, wheel_angles.step)

    def unexplained_at(lags: npt.NDArray[np.floating[Any]], spans: Sequence[slice]) -> Array:
        """Fractions by span, lag and axis."""
        found = np.empty((len(spans), len(lags), 3))
        for index, lag in enumerate(lags):
            rates = changes(integral, times + lag)
            kept = usable & near(gyro.time, times + lag, gyro.step)
            found[:, index] = [unexplained(speeds[one][kept[one]], rates[one][kept[one]]) for one in spans]
        return found

    coarse = step * np.arange(-int(MAX_LAG / step), int(MAX_LAG / step) + 1)
    edges = np.linspace(0, len(times), blocks + 1).astype(int)
    parts = [slice(a, b) for a, b in itertools.pairwise(edges)]
    # The sum over blocks has its peak in the middle of a drift.
    peak = int(np.argmax(_likelihood(unexplained_at(coarse, parts)).sum(axis=0)))
    if peak in (0, len(coarse) - 1):
        return None
    reach = 2 * FINE * (1 if seconds < DRIFTS else 3)
    lags = coarse[peak] + step / FINE * np.arange(-reach, reach + 1, 2)
    whole, *own = unexplained_at(lags, [slice(None), *parts])
    best = 1.0 - float(whole.mean(axis=1).min())
    if best < LEAST_EXPLAINED:
        return None
    offsets = np.array([_peak(lags, _likelihood(one)) for one in own])
    middles = times[(edges[1:] + edges[:-1]) // 2]
    time = float(middles.mean())
    drift, drift_error = 0.0, float("inf")
    if seconds >= DRIFTS:
        away = middles - time
        drift = float(away @ offsets / (away @ away))
        rest = offsets - offsets.mean() - drift * away
        drift_error = float(np.sqrt((rest @ rest / (blocks - 2) + (SYSTEMATIC * step) ** 2) / (away @ away)))
    is_drifting = abs(drift) > SIGNIFICANT * drift_error
    spread = np.std(offsets - drift * (middles - time) if is_drifting else offsets, ddof=1)
    mean, together = float(offsets.mean()), _peak(lags, _likelihood(whole))
    # The mean of the blocks and the whole log are two estimates: what friction adds differs between them.
    error = float(np.linalg.norm([spread / np.sqrt(blocks), mean - together, SYSTEMATIC * step]))
    return Offset(mean if is_drifting else together, error, best, time, drift, drift_error)


def _likelihood(fractions: Array) -> Array:
    """Log-likelihood of each lag per half sample, without constants, from unexplained fractions by lag and axis."""
    return np.asarray(-np.log(fractions).sum(axis=-1))


def _smooth(series: Series) -> Any:
    """Cubics between samples: linear interpolation would shift fast motion by up to a tenth of a sample."""
    with require("the offset between clocks", "identify"):
        from scipy.interpolate import Akima1DInterpolator
    return Akima1DInterpolator(series.time, series.values)


def fast(rates: Array, step: float) -> Array:
    """Rates minus their moving average."""
    half = max(int(0.5 * SLOW / step), 1)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(rates, axis=0)])
    places = np.arange(len(rates))
    low, high = np.maximum(places - half, 0), np.minimum(places + half + 1, len(rates))
    return np.asarray(rates - (sums[high] - sums[low]) / (high - low)[:, None])


def near(time: Array, places: Array, step: float) -> npt.NDArray[np.bool_]:
    """Whether places are between samples without a gap."""
    after = np.clip(np.searchsorted(time, places), 1, len(time) - 1)
    return np.asarray(time[after] - time[after - 1] <= MAX_GAP * step)


def unexplained(causes: Array, effects: Array) -> Array:
    """Fraction of the squares of each effect that no linear function of the causes explains."""
    if len(causes) < 2 * causes.shape[1]:
        return np.ones(effects.shape[1])
    rest = effects - causes @ np.linalg.lstsq(causes, effects, rcond=1e-9)[0]
    squares = (effects**2).sum(axis=0)
    return np.asarray((rest**2).sum(axis=0) / np.where(squares > 0.0, squares, 1.0)).clip(1e-12, 1.0)


def _peak(lags: Array, values: Array) -> float:
    """The place of the maximum, between samples, of a smooth curve."""
    best = int(np.clip(np.argmax(values), 1, len(values) - 2))
    a, b, _ = np.polyfit(lags[best - 1 : best + 2] - lags[best], values[best - 1 : best + 2], 2)
    shift = np.clip(-b / (2.0 * a), -np.ptp(lags), np.ptp(lags)) if a < 0.0 else 0.0
    return float(lags[best] + shift)
