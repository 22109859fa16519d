"""Sensor noise, from the log itself and from the residuals of a fit; windows that no robot explains."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.log import COLUMNS, UNITS, SensorLog
from ballbot_rs.identification.problem import Point, Problem

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Smallest standard deviations, far below real sensors: rad, rad/s, m/s².
LEAST: Final[Mapping[str, float]] = {"wheel_angle": 1e-5, "gyro": 1e-4, "acceleration": 1e-3}
#: Largest residuals, in standard deviations of the given noise or of the noise in third differences.
MAX_EXCESS: Final = 10.0
#: Least fraction of the predicted changes that a column must show before the fit, when friction or inertia may be far
#: off, and the least and most after it.
LEAST_GAIN: Final = -0.2
GAINS: Final = (0.5, 2.0)
#: Changes of a column, in standard deviations of its noise, above which its gain is checked.
JUDGED: Final = 2.0
#: Windows whose mean square is within this fraction of the noise always count as explained.
EXACT: Final = 0.1


def first_guess(log: SensorLog) -> dict[str, float]:
    """Noise from third differences of the measurements, to which smooth signals hardly contribute."""
    series = {"wheel_angle": log.wheel_angles, "gyro": log.gyro, "acceleration": log.accelerations}
    found = {}
    for name, values in series.items():
        if values is not None:
            # The third difference of white noise has 1 + 9 + 9 + 1 times its variance.
            differences = np.diff(values, n=3, axis=0)
            found[name] = max(float(np.sqrt(np.mean(differences**2) / 20.0)), LEAST[name])
    return found


def check(found: Mapping[str, float], expected: Mapping[str, float]) -> None:
    """A ValueError names a sensor whose residuals far exceed its noise: they are not noise."""
    for name, value in found.items():
        if value > MAX_EXCESS * expected[name]:
            raise InvalidInputError(
                f"the model does not explain the log: the residuals of {name} are {value:.2g} {UNITS[name]}, the limit "
                f"is {MAX_EXCESS:g} "
                f"times its noise of {expected[name]:.2g} {UNITS[name]}; the signs, units or order of columns are "
                f"wrong, the robot has "
                "other parameters, or fields lacks one"
            )


def check_columns(
    problem: Problem,
    point: Point,
    kept: Mask,
    spreads: Mapping[str, float],
    log: SensorLog,
    limits: tuple[float, float],
) -> None:
    """A ValueError names the column with the least, or the most, of the change that the other columns predict."""
    gains, sizes = problem.gains(point, spreads, kept)
    judged = sizes > JUDGED * problem.spread(first_guess(log))
    low, high = limits
    excess = np.where(judged, np.maximum(low - gains, gains - high), -np.inf)
    worst = int(np.argmax(excess))
    if not excess[worst] > 0.0:
        return
    titles = (*COLUMNS["wheel_angles"], *COLUMNS["gyro"], *COLUMNS["accelerations"])
    expected = f"at least {low:g}" if high == np.inf else f"from {low:g} to {high:g}"
    raise InvalidInputError(
        f"{titles[worst]} contradicts the other columns: it shows {gains[worst]:.2g} times the changes that follow "
        f"from them, expected {expected}; the sign, unit or axis of it, of torques or of wheel angles is wrong, "
        "or imu_position"
    )


def given(noise: Mapping[str, float], log: SensorLog) -> dict[str, float]:
    """Noise given by the caller.

    Raises:
        ValueError: an unknown sensor, a missing one, or a number that is not above zero.
    """
    needed = [name for name in LEAST if name != "acceleration" or log.accelerations is not None]
    for name, value in noise.items():
        if name not in LEAST:
            raise InvalidInputError(f"unknown sensor {name!r} in noise: expected {', '.join(LEAST)}")
        if not (np.isfinite(value) and value > 0.0):
            raise InvalidInputError(f"noise of {name} is {value}, it must be finite and above 0")
    if missing := [name for name in needed if name not in noise]:
        raise InvalidInputError(f"noise lacks {', '.join(missing)}")
    return {name: float(noise[name]) for name in needed}


def estimated(
    problem: Problem, point: Point, leverage: Array, kept: Mask, noise: Mapping[str, float]
) -> dict[str, float]:
    """Noise of each sensor: the root of its sum of squares over its degrees of freedom."""
    chosen = kept[problem.windows.window]
    found = {}
    for name, place in problem.sensors.items():
        used = problem.used[chosen][:, place]
        freedom = used.sum() - leverage[chosen][:, place][used].sum()
        square = (point.residuals[chosen][:, place] ** 2).sum() / max(freedom, 1.0)
        found[name] = max(float(noise[name] * np.sqrt(square)), LEAST[name])
    return found


def explained(problem: Problem, point: Point, leverage: Array, kept: Mask, limit: float) -> Mask:
    """Windows whose mean square residual is at most `limit` times the median of all."""
    bounds = problem.windows.bounds[:-1]
    freedom = np.add.reduceat(np.where(problem.used, 1.0 - leverage, 0.0).sum(axis=1), bounds)
    with np.errstate(invalid="ignore"):
        squares = point.costs / np.maximum(freedom, 1.0)
    usual = max(float(np.median(squares[kept])), EXACT)
    found: Mask = squares <= limit * usual
    return found
