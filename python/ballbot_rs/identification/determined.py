"""Identifiability: windows that the model explains, parameters that differ in their effects, their covariance."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.parameters import Fitted
from ballbot_rs.identification.problem import Point, Problem

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Largest fraction of windows that may be rejected.
MAX_REJECTED: Final = 1.0 / 3.0
#: Largest condition number. Indistinguishable parameters reach 1e4 in `contact`, whose time steps distinguish a
#: little more.
MAX_CONDITION: Final = 3e3
#: Largest condition number with a payload: its damping is far less certain than the CoM of the body. Indistinguishable
#: parameters reach 8e4.
MAX_CONDITION_OF_PAYLOAD: Final = 2e4
#: Effect on the measurements that counts as none, as a fraction of the largest effect.
SILENT: Final = 1e-5
#: Largest standard deviation along any direction, in typical sizes of the parameters.
MAX_UNCERTAINTY: Final = 1.0
#: Least component of a parameter along a direction for the message to name it.
NAMED: Final = 0.2
#: Probability of the least decrease of the sum of squares by a payload under noise alone, at one frequency; a fit
#: finds the best of many.
SWAYS_BY_CHANCE: Final = 1e-15
#: Distance from a limit, in typical sizes, within which a number is at the limit.
LIMIT: Final = 1e-4


def check_windows(problem: Problem, kept: Mask, log: SensorLog) -> None:
    """A ValueError reports where the log contradicts the model, if too many windows do."""
    left_out = int((~kept).sum())
    limit = int(MAX_REJECTED * len(kept))
    if left_out > limit:
        first = log.time[problem.windows.rows[problem.windows.bounds[int(np.argmin(kept))]]]
        raise InvalidInputError(
            f"{left_out} of {len(kept)} windows contradict the model, the limit is {limit}; the first begins at "
            f"{first:g} s: wheels slip there, something touches the robot, the signs or units of a column are wrong, "
            "or fields lacks a parameter"
        )


def check_determined(problem: Problem, derivatives: Array, kept: Mask, fit: Point | None = None) -> None:
    """A ValueError names the parameters that the log does not determine; after a fit, also uncertain parameters.

    After a fit, numbers at a limit are not checked.
    """
    unknowns, flat = problem.fitted, derivatives[kept[problem.windows.window]].reshape(-1, derivatives.shape[-1])
    free = np.ones(len(unknowns.names), dtype=np.bool_) if fit is None else ~at_limit(unknowns, fit.values)
    names, flat = np.array(unknowns.names)[free], flat[:, free]
    if not len(names):
        return
    sizes = np.linalg.norm(flat, axis=0)
    silent = sizes <= SILENT * sizes.max()
    if silent.any():
        raise InvalidInputError(
            f"the log does not depend on {', '.join(names[silent])}: a change by its typical size changes the "
            f"measurements by less than {SILENT:.0e} of the largest effect; leave it out of fields"
        )
    of_payload = np.array([name.startswith("payload_") for name in names])
    if of_payload.any() and not of_payload.all():
        _check_apart(names[~of_payload], flat[:, ~of_payload], MAX_CONDITION, fit is not None)
    _check_apart(names, flat, MAX_CONDITION_OF_PAYLOAD if of_payload.any() else MAX_CONDITION, fit is not None)


def _check_apart(names: npt.NDArray[np.str_], flat: Array, most: float, fitted: bool) -> None:
    """A ValueError names numbers that have the same effect together, or after a fit are uncertain."""
    _, singular, directions = np.linalg.svd(np.linalg.qr(flat)[1])
    condition = singular[0] / max(singular[-1], 1e-300)
    deviation = 1.0 / max(singular[-1], 1e-300)
    if condition > most or (fitted and deviation > MAX_UNCERTAINTY):
        share = np.abs(directions[-1])
        group = names[share > NAMED * share.max()]
        what = f"{group[0]}" if len(group) == 1 else f"{', '.join(group)} apart from each other"
        raise InvalidInputError(
            f"the log does not determine {what}: the condition number is {condition:.2g} (limit {most:g}) and "
            f"the standard deviation of their combination {deviation:.2g} of their typical size (limit "
            f"{MAX_UNCERTAINTY:g}); leave one of them out of fields, or record more excitation"
        )


def check_sways(with_payload: float, without: float, numbers: int) -> None:
    """A ValueError reports a log that a payload fixed to the body explains as well: no payload sways in it.

    The starts of a payload follow noise, too: without a payload that sways they lower the sum of squares by a
    chi-squared variable of their number.

    Args:
        with_payload: sum of squares of the fit, in units of the noise variance.
        without: sum of squares of a fit with the payload fixed to the body.
        numbers: how many numbers the former has more.
    """
    from scipy.special import chdtri

    least = float(chdtri(numbers, SWAYS_BY_CHANCE))
    if without - with_payload < least:
        raise InvalidInputError(
            "the log shows no payload that sways: a payload fixed to the body explains it equally well, with a sum of "
            f"squares that is {without - with_payload:.3g} noise variances larger (limit {least:.3g}, as far as noise "
            "alone may reach); leave the payload out of fields, or record more excitation"
        )


def at_limit(unknowns: Fitted, values: Array) -> Mask:
    """Which numbers are at one of their limits."""
    near: Mask = np.minimum(values - unknowns.low, unknowns.high - values) <= LIMIT * unknowns.scales
    return near


def covariance_of(flat: Array, free: Mask) -> tuple[Array, Array]:
    """Singular values of the derivatives, and the covariance; numbers at a limit get the covariance they have alone."""
    _, singular, directions = np.linalg.svd(np.linalg.qr(flat[:, free])[1])
    covariance = np.diag(1.0 / np.maximum((flat**2).sum(axis=0), 1e-300))
    covariance[np.ix_(free, free)] = (directions.T / singular**2) @ directions
    return singular, covariance


def jackknife_errors(slopes: Sequence[Array], residuals: Sequence[Array], free: Mask) -> Array:
    """Standard errors from estimates that leave one window out each, to first order (Miller, Biometrika 61, 1974).

    They require neither white noise nor a correct model, but independent windows. Numbers at a limit have zero errors.

    Args:
        slopes: derivatives of each window, shape (rows, p).
        residuals: of each window, shape (rows,).
        free: which numbers are not at a limit, shape (p,).
    """
    normal = sum(one[:, free].T @ one[:, free] for one in slopes)
    changes = [
        np.linalg.lstsq(normal - one[:, free].T @ one[:, free], one[:, free].T @ own, rcond=1e-12)[0]
        for one, own in zip(slopes, residuals, strict=True)
    ]
    spread = np.array(changes) - np.mean(changes, axis=0)
    count = len(slopes)
    errors = np.zeros(len(free))
    errors[free] = np.sqrt((count - 1.0) / count * (spread**2).sum(axis=0))
    return errors
