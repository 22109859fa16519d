"""Noise of the sensors, from the log alone and from the residuals of a fit; windows that no robot explains."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.log import SensorLog
from ballbot_rs.identification.problem import Point, Problem

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Smallest standard deviations, far below those of sensors: rad, rad/s, m/s².
LEAST: Final[Mapping[str, float]] = {"wheel_angle": 1e-5, "gyro": 1e-4, "acceleration": 1e-3}
UNITS: Final[Mapping[str, str]] = {"wheel_angle": "rad", "gyro": "rad/s", "acceleration": "m/s²"}
#: Largest residuals, in standard deviations of the noise that is given or that third differences show.
MAX_EXCESS: Final = 10.0
#: Windows whose mean square is within this share of the noise always count as explained.
EXACT: Final = 0.1


def first_guess(log: SensorLog) -> dict[str, float]:
    """Noise that third differences of the measurements show, which those of smooth signals hardly have."""
    series = {"wheel_angle": log.wheel_angles, "gyro": log.gyro, "acceleration": log.accelerations}
    found = {}
    for name, values in series.items():
        if values is not None:
            # The third difference of white noise has 1 + 9 + 9 + 1 times its variance.
            differences = np.diff(values, n=3, axis=0)
            found[name] = max(float(np.sqrt(np.mean(differences**2) / 20.0)), LEAST[name])
    return found


def check(found: Mapping[str, float], expected: Mapping[str, float]) -> None:
    """A ValueError names a sensor whose residuals are far beyond its noise: what is left is no noise."""
    for name, value in found.items():
        if value > MAX_EXCESS * expected[name]:
            raise InvalidInputError(
                f"the model does not explain the log: the residuals of {name} are {value:.2g} {UNITS[name]}, the limit "
                f"is {MAX_EXCESS:g} "
                f"times its noise of {expected[name]:.2g} {UNITS[name]}; the signs, units or order of columns are "
                f"wrong, the robot has "
                "other parameters, or fields lacks one"
            )


def given(noise: Mapping[str, float], log: SensorLog) -> dict[str, float]:
    """Noise that the caller gives.

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
    """Noise of each sensor: the root of its sum of squares by its degrees of freedom."""
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
