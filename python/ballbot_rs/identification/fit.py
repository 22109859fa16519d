"""The fit: nonlinear least squares over the parameters, in passes that update the noise and the accepted windows."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._robot import Robot
from ballbot_rs.identification import noise as noise_of
from ballbot_rs.identification import starts as starts_of
from ballbot_rs.identification.determined import (
    at_limit,
    check_determined,
    check_sways,
    check_windows,
    covariance_of,
    jackknife_errors,
)
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.parameters import NOTHING, Fitted, fitted
from ballbot_rs.identification.parameters import Robot as FitRobot
from ballbot_rs.identification.problem import Point, Problem
from ballbot_rs.identification.result import IdentifiedParams, actuators_of, units_of
from ballbot_rs.identification.setup import prepare

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Parameters fitted by default.
FIELDS: Final = (
    "body_mass",
    "body_inertia",
    "body_com_height",
    "body_com_offset",
    "ball_viscous_friction",
    "wheel_viscous_friction",
    "wheel_coulomb_friction",
    "delay",
)
#: Most passes, and the relative change of the noise that ends them.
MAX_PASSES: Final = 8
SETTLED: Final = 0.02
#: Decrease of the sum of squares by other window starts that ends the passes, in units of the noise variance.
GAIN: Final = 0.5
#: Evaluations of the residuals in a pass.
MAX_EVALUATIONS: Final = 60
#: Simulations of a usual fit, for the progress.
USUAL: Final = 100


@named
def identify(
    log: SensorLog | str | PathLike[str],
    robot: Robot | None = None,
    fields: Sequence[str] | None = None,
    *,
    actuators: Mapping[str, Any] | str | None = None,
    model: Literal["spatial", "contact", "rigid"] | str = "contact",
    sim_dt: float = 0.002,
    window: float = 0.5,
    imu_position: Sequence[float] = (0.0, 0.0, 0.0),
    noise: Mapping[str, float] | None = None,
    rejection: float | None = 3.0,
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> IdentifiedParams:
    """Fits parameters of a robot to a log by nonlinear least squares.

    ```python
    log = bb.record_log(bb.Params.paper().replace(body_mass=2.4), seconds=4.0)
    print(bb.identify(log, "paper", ["body_mass"], sim_dt=0.005).params.body_mass)
    ```

    The log is divided into windows. Each is simulated under the logged torques from its own initial state, which is
    also fitted; the residuals are measured minus simulated wheel angles, body rates and specific forces, divided by the
    noise of their sensor. docs/identify.md has the formulas, how to record a log, and which parameters are
    indistinguishable.

    Args:
        log: the log, or the path of its file, as `SensorLog.read` takes it.
        robot: as in `simulate`, to start from, with the values of all parameters that are not fitted; None is the
            paper's.
        fields: parameters of `Params` by name (except `max_wheel_torque`), `delay`, `lag` and `strength` of the
            motors, and `gyro_bias` and `acc_bias` of the IMU. A vector is fitted with all its components, stiffness and
            damping of a payload along x and y. None fits mass, inertia and CoM of the body, the frictions of ball and
            wheels, and the delay.
        actuators: motors to start from, as `actuators=` of an environment, with only delay, lag and strengths;
            None is ideal.
        model: of the simulations: `spatial`, `contact` or `rigid`.
        sim_dt: time step of the model, s, at most the log's median step.
        window: length of a window, s, from 0.05 to 2.
        imu_position: position of the accelerometer in the body frame, m.
        noise: standard deviation of each sensor, with the keys `wheel_angle` (rad), `gyro` (rad/s) and, with
            accelerations, `acceleration` (m/s²); None estimates them from the residuals.
        rejection: windows with a mean square residual of more than this many times the median are rejected; None
            rejects none.
        num_threads: of the simulations; None uses all cores.
        progress: called with the number of simulations of all windows done, and the expected number.

    Raises:
        ValueError: a bad log or argument; parameters that the log does not determine, which the message names; a log
            that the model does not explain.
        OSError: a file cannot be read.
        ModuleNotFoundError: SciPy is not installed.
        KeyboardInterrupt: Ctrl-C.
    """
    with require("identification", "identify"):
        import scipy.optimize  # noqa: F401
    fields = FIELDS if fields is None else fields
    log, base, windows, simulator = prepare(
        log, robot, actuators, model, sim_dt, window, imu_position, num_threads, fields
    )
    if rejection is not None and not rejection > 1.0:
        raise InvalidInputError(f"rejection = {rejection}, it must be above 1")
    unknowns = fitted(fields, base, sim_dt)
    if "acc_bias" in unknowns.fields and log.accelerations is None:
        raise InvalidInputError("fields has acc_bias, but the log has no acc_x, acc_y, acc_z")
    count = 0

    def called() -> None:
        nonlocal count
        count += 1
        progress(count, max(USUAL, count + 1))

    problem = Problem(log, windows, simulator, unknowns, base, called)
    starts = starts_of.estimated(log, windows, base.params)
    spreads = noise_of.first_guess(log) if noise is None else noise_of.given(noise, log)
    point, derivatives, spreads, kept = _passes(problem, starts, spreads, noise is None, rejection, log)
    if any(field.startswith("payload_") for field in fields):
        fixed = Problem(log, windows, simulator, *_fixed(unknowns, point.robot, sim_dt), called)
        _check_payload(problem, fixed, point, spreads, kept)
    progress(count, count)
    return _result(problem, base, log, point, derivatives, spreads, kept, model, sim_dt, noise is None)


def _passes(
    problem: Problem, starts: Array, spreads: dict[str, float], estimate: bool, rejection: float | None, log: SensorLog
) -> tuple[Point, Array, dict[str, float], Mask]:
    """Fits until noise and windows converge: the last point, its derivatives, the noise, and which windows count."""
    point = problem.at(problem.fitted.start, starts, spreads)
    standing = np.isfinite(point.costs)
    kept = standing.copy()
    expected = spreads
    check_windows(problem, kept, log)
    noise_of.check_columns(problem, point, kept, spreads, log, (noise_of.LEAST_GAIN, np.inf))
    check_determined(problem, problem.derivatives(point, spreads)[0], kept)
    rng = np.random.default_rng(0)
    for _ in range(MAX_PASSES):
        fit = _fit(problem, point, spreads, kept)
        point = problem.explored(fit, spreads, rng)
        gain = float((fit.costs[kept] - point.costs[kept]).sum())
        derivatives, _ = problem.derivatives(point, spreads)
        leverage = problem.leverage(point, derivatives, kept)
        before, old = kept, spreads
        if rejection is not None:
            kept = standing & noise_of.explained(problem, point, leverage, kept, rejection)
            check_windows(problem, kept, log)
        if estimate:
            spreads = noise_of.estimated(problem, point, leverage, kept, spreads)
        steady = (kept == before).all() and all(abs(spreads[name] / old[name] - 1.0) < SETTLED for name in old)
        if steady and gain < GAIN:
            break
        point = problem.at(point.values, point.starts, spreads)
    noise_of.check_columns(problem, point, kept, spreads, log, noise_of.GAINS)
    noise_of.check(noise_of.estimated(problem, point, leverage, kept, old), expected)
    ratio = problem.spread(old) / problem.spread(spreads)
    derivatives = derivatives * ratio[:, None]
    point = dataclasses.replace(point, residuals=point.residuals * ratio)
    check_determined(problem, derivatives, kept, point)
    return point, derivatives, spreads, kept


def _fixed(unknowns: Fitted, robot: FitRobot, sim_dt: float) -> tuple[Fitted, FitRobot]:
    """What is fitted if the payload is fixed to the body, and the robot."""
    fields = [field for field in unknowns.fields if not field.startswith("payload_")]
    fixed = dataclasses.replace(robot, params=robot.params.with_payloads_fixed())
    return (fitted(fields, fixed, sim_dt) if fields else NOTHING), fixed


def _check_payload(problem: Problem, fixed: Problem, point: Point, spreads: Mapping[str, float], kept: Mask) -> None:
    """A ValueError reports a fitted payload without which the log is explained as well."""
    other = fixed.at(fixed.fitted.start, point.starts[:, : len(starts_of.COORDINATES)], spreads)
    if np.isfinite(other.costs[kept]).all() and fixed.fitted.names:
        other = _fit(fixed, other, spreads, kept)
    more = len(problem.fitted.names) - len(fixed.fitted.names) + len(starts_of.OF_PAYLOAD) * int(kept.sum())
    own = float((point.residuals[kept[problem.windows.window]] ** 2).sum())
    check_sways(own, float(other.costs[kept].sum()), more)


def _fit(problem: Problem, first: Point, spreads: Mapping[str, float], kept: Mask) -> Point:
    """One nonlinear least-squares fit over the fitted numbers, in units of their scales."""
    from scipy.optimize import least_squares

    unknowns, rows = problem.fitted, kept[problem.windows.window]
    known: dict[bytes, Point | None] = {}
    # The point of the derivatives: a trial starts from its best starts there, moved along their tangents.
    last, tangents = first, np.zeros((*first.starts.shape, len(unknowns.names)))
    # Invalid parameters, or a robot that falls, are rejected as a step without a decrease.
    rejected = np.full(int(rows.sum()) * problem.channels, 10.0 * np.sqrt(np.mean(first.residuals[rows] ** 2) + 1.0))

    def at(scaled: Array) -> Point | None:
        key = scaled.tobytes()
        if key not in known:
            starts = last.starts + tangents @ (scaled - last.values / unknowns.scales)
            try:
                point = problem.at(scaled * unknowns.scales, starts, spreads)
            except ValueError:
                known[key] = None
            else:
                known[key] = point if np.isfinite(point.costs[kept]).all() else None
        return known[key]

    def residuals(scaled: Array) -> Array:
        point = at(scaled)
        return rejected if point is None else point.residuals[rows].reshape(-1)

    def jacobian(scaled: Array) -> Array:
        nonlocal last, tangents
        point = at(scaled)
        if point is None:
            return np.zeros((len(rejected), len(scaled)))
        derivatives, tangents = problem.derivatives(point, spreads)
        last = point
        return -derivatives[rows].reshape(len(rejected), -1)

    low, high = unknowns.low / unknowns.scales, unknowns.high / unknowns.scales
    margin = 1e-9
    begin = np.clip(first.values / unknowns.scales, low + margin, high - margin)
    done = least_squares(
        residuals, begin, jacobian, bounds=(low, high), xtol=1e-5, ftol=1e-6, gtol=1e-8, max_nfev=MAX_EVALUATIONS
    )
    point = at(done.x)
    if point is None or done.status == 0:
        raise InvalidInputError(
            f"the fit has not converged after {done.nfev} evaluations: start from a robot that is closer, or fit "
            "fewer fields"
        )
    return point


def _result(
    problem: Problem,
    base: FitRobot,
    log: SensorLog,
    point: Point,
    derivatives: Array,
    spreads: dict[str, float],
    kept: Mask,
    model: str,
    sim_dt: float,
    estimate: bool,
) -> IdentifiedParams:
    from scipy.special import stdtrit

    unknowns, windows = problem.fitted, problem.windows
    chosen = kept[windows.window]
    flat = derivatives[chosen].reshape(-1, len(unknowns.names))
    # A number at a limit has no meaningful interval, and does not affect the others'.
    free = ~at_limit(unknowns, point.values)
    singular, covariance = covariance_of(flat, free)
    linear = np.sqrt(np.diag(covariance))
    places = [windows.rows_of(i) for i in np.flatnonzero(kept).tolist()]
    # Without an estimate of the noise there is no jackknife.
    jackknife = np.zeros_like(linear)
    if estimate:
        slopes = [derivatives[one].reshape(-1, len(unknowns.names)) for one in places]
        residuals = [point.residuals[one].reshape(-1) for one in places]
        jackknife = jackknife_errors(slopes, residuals, free)
    errors = np.maximum(linear, jackknife)
    measurements = int(problem.used[chosen].sum())
    # Of each window, its start and the origins of three encoders.
    freedom = measurements - (point.starts.shape[1] + 3) * int(kept.sum()) - len(unknowns.names)
    of_measurements, of_windows = (float(stdtrit(max(n, 1), 0.975)) for n in (freedom, len(places) - 1))
    half = np.maximum(of_measurements * linear, of_windows * jackknife) * unknowns.scales
    rows = [windows.rows[windows.rows_of(i)] for i in np.flatnonzero(~kept).tolist()]
    return IdentifiedParams(
        params=point.robot.params,
        actuators=actuators_of(unknowns.fields, point.robot.motors, sim_dt),
        gyro_bias=point.robot.gyro_bias,
        acc_bias=point.robot.acc_bias,
        names=unknowns.names,
        units=units_of(unknowns.places),
        values=point.values,
        standard_errors=errors * unknowns.scales,
        correlation=covariance / np.outer(linear, linear),
        intervals=np.stack([point.values - half, point.values + half], axis=-1),
        nominal=_nominal(unknowns, base),
        at_limit=tuple(np.array(unknowns.names)[at_limit(unknowns, point.values)].tolist()),
        condition_number=float(singular[0] / singular[-1]) if len(singular) else 1.0,
        noise=spreads,
        rejected=tuple((float(log.time[one[0]]), float(log.time[one[-1]])) for one in rows),
        windows=len(windows),
        measurements=measurements,
        model=model,
        sim_dt=sim_dt,
    )


def _nominal(unknowns: Fitted, base: FitRobot) -> Array:
    return np.array([unknowns.number(base, place) for place in unknowns.places])
