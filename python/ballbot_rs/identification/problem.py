"""The least-squares problem: residuals of all windows, with the starts of the windows eliminated."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.parameters import Fitted, Robot
from ballbot_rs.identification.simulation import SENSORS, Column, Simulator, measured
from ballbot_rs.identification.starts import DEFLECTION, TILT, steps_of
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Finite-difference steps, in typical sizes of the parameters.
DIFFERENCE: Final = 1e-4
#: Simulations of all windows in a search of their starts, and the decreases of a window's sum of squares that end it:
#: as a fraction, and in units of the noise variance.
MAX_SEARCH: Final = 30
DECREASE: Final = 1e-6
NEGLIGIBLE: Final = 1e-2
#: Smallest fraction of a Gauss-Newton step that is tried.
SHORTEST: Final = 0.05
#: Starts tried around the best start, and their distances, in standard deviations.
TRIALS: Final = 8
SIZES: Final = (0.1, 0.3, 1.0)
#: Longest step of a tilt and of a payload's deflection within a search, rad and m.
MAX_TILT_STEP: Final = 0.3
MAX_DEFLECTION_STEP: Final = 0.3


@dataclasses.dataclass(frozen=True)
class Point:
    """Residuals of all windows at some values, at the starts that fit best."""

    values: Array
    robot: Robot
    #: Shape (w, n), with 8 coordinates or 12 with a payload.
    starts: Array
    #: In standard deviations of the noise, minus the mean of each window's wheel angles, shape (m, channels).
    residuals: Array
    #: Orthonormal bases of the effects of each window's start, shape (rows · channels, n) each.
    bases: list[Array]
    #: The derivatives of each window with respect to its start are its basis times this matrix, shape (n, n).
    triangles: list[Array]
    #: Sum of squares of each window, shape (w,); infinite where the robot fell.
    costs: Array


class Problem:
    """Residuals and their derivatives.

    Args:
        log: the log.
        windows: of it.
        simulator: of these windows.
        fitted: the numbers that are fitted.
        base: the robot with the other numbers.
        called: after each simulation.
    """

    def __init__(
        self,
        log: SensorLog,
        windows: Windows,
        simulator: Simulator,
        fitted: Fitted,
        base: Robot,
        called: Callable[[], None],
    ) -> None:
        self.windows, self.fitted = windows, fitted
        self._simulator, self._base, self._called = simulator, base, called
        self._measured = measured(log, windows)
        self._steps = steps_of(base.params)
        self.channels = simulator.channels
        #: Which numbers are measurements: the specific force in a window's first row is not.
        self.used: Mask = np.ones(self._measured.shape, dtype=np.bool_)
        self.used[windows.bounds[:-1], SENSORS["acceleration"]] = False
        self.sensors: Mapping[str, slice] = {
            name: place for name, place in SENSORS.items() if place.stop <= self.channels
        }

    def spread(self, noise: Mapping[str, float]) -> Array:
        """Standard deviation of each channel."""
        found = np.empty(self.channels)
        for name, place in self.sensors.items():
            found[place] = noise[name]
        return found

    def gains(self, point: Point, noise: Mapping[str, float], kept: Mask) -> tuple[Array, Array]:
        """Ratio of measured to predicted changes within a window, by channel: 1 if both come from the same robot.

        Gravity counts as a change: the specific force along z is not centered.

        Returns:
            The gains, and the root mean squares of the measured changes, shape (channels,) each.
        """
        windows, used = self.windows, self.used & kept[self.windows.window][:, None]
        predicted = self._measured - point.residuals * self.spread(noise)
        place = np.arange(self.channels) != SENSORS["acceleration"].stop - 1
        changes = []
        for rows in (self._measured, predicted):
            sums = np.add.reduceat(np.where(used, rows, 0.0), windows.bounds[:-1], axis=0)
            counts = np.add.reduceat(used, windows.bounds[:-1], axis=0, dtype=np.int64)
            means = sums / np.maximum(counts, 1)
            changes.append(np.where(used, rows - np.where(place, means, 0.0)[windows.window], 0.0))
        own, expected = changes
        squares = (expected**2).sum(axis=0)
        gains = (own * expected).sum(axis=0) / np.maximum(squares, 1e-300)
        return gains, np.sqrt((own**2).sum(axis=0) / np.maximum(used.sum(axis=0), 1))

    def at(self, values: Array, starts: Array, noise: Mapping[str, float]) -> Point:
        """The point at some values, its starts searched from `starts` by Gauss-Newton steps in each window.

        Raises:
            ValueError: the values do not describe a robot.
        """
        robot = self.fitted.robot(values, self._base)
        everything = np.ones(len(self.windows), dtype=np.bool_)
        best, steps = self._linearized(values, robot, starts, noise, everything)
        factor = np.ones(len(self.windows))
        for _ in range(MAX_SEARCH):
            searched = (self._promise(best) > np.maximum(DECREASE * best.costs, NEGLIGIBLE)) & (factor > SHORTEST)
            if not searched.any():
                break
            trial = best.starts + factor[:, None] * steps
            point, next_steps = self._linearized(values, robot, trial, noise, searched)
            better = np.zeros_like(searched)
            better[searched] = point.costs < best.costs[searched]
            taken = better[searched]
            steps[better] = next_steps[taken]
            factor = np.where(better, 1.0, 0.25 * factor)
            self._take(best, point, better, searched)
        return best

    def _promise(self, point: Point) -> Array:
        """Decrease of each window's sum of squares that the next step would give if the robot were linear."""
        found = np.zeros(len(self.windows))
        for index, basis in enumerate(point.bases):
            if np.isfinite(point.costs[index]):
                taken = basis.T @ point.residuals[self.windows.rows_of(index)].reshape(-1)
                found[index] = taken @ taken
        return found

    def explored(self, point: Point, noise: Mapping[str, float], rng: np.random.Generator) -> Point:
        """The point after a search from starts around its own, where these are better.

        Dry friction and slip make a window's sum of squares nonsmooth: its search may end short of the minimum.
        """
        trials = []
        for size in np.repeat(SIZES, TRIALS):
            draws = size * rng.standard_normal(point.starts.shape)
            pairs = zip(point.triangles, draws, strict=True)
            changes = np.array([np.linalg.lstsq(triangle, draw, rcond=1e-12)[0] for triangle, draw in pairs])
            trials.append(Column(point.robot, point.starts + _shortened(changes, DEFLECTION, MAX_DEFLECTION_STEP)))
        found, upright = self._run(self.windows, np.ones(len(self._measured), dtype=np.bool_), trials)
        starts, least = point.starts.copy(), point.costs.copy()
        for read, standing, trial in zip(found, upright, trials, strict=True):
            squares = _centered((self._measured - read) / self.spread(noise), self.windows) ** 2
            costs = np.add.reduceat(squares.sum(axis=1), self.windows.bounds[:-1])
            better = standing & (costs < least)
            starts[better], least[better] = trial.starts[better], costs[better]
        other = self.at(point.values, starts, noise)
        better = other.costs < point.costs
        best = dataclasses.replace(
            point,
            starts=point.starts.copy(),
            residuals=point.residuals.copy(),
            bases=list(point.bases),
            triangles=list(point.triangles),
            costs=point.costs.copy(),
        )
        self._take(best, other, better, np.ones_like(better))
        return best

    def _take(self, best: Point, point: Point, better: Mask, searched: Mask) -> None:
        """Copies windows that are better into the best point; the other point has the windows that were searched."""
        taken = better[searched]
        best.starts[better] = point.starts[taken]
        best.costs[better] = point.costs[taken]
        rows, windows = better[self.windows.window], self.windows.window[searched[self.windows.window]]
        best.residuals[rows] = point.residuals[better[windows]]
        for place, index in enumerate(np.flatnonzero(searched).tolist()):
            if better[index]:
                best.bases[index], best.triangles[index] = point.bases[place], point.triangles[place]

    def _linearized(
        self, values: Array, robot: Robot, starts: Array, noise: Mapping[str, float], chosen: Mask
    ) -> tuple[Point, Array]:
        """The point of some windows at given starts, and the Gauss-Newton step of each."""
        windows, starts = self.windows.subset(chosen), starts[chosen]
        rows = chosen[self.windows.window]
        changed = [Column(robot, starts + change) for change in np.diag(self._steps)]
        found, upright = self._run(windows, rows, [Column(robot, starts), *changed])
        spread = self.spread(noise)
        residuals = _centered((self._measured[rows] - found[0]) / spread, windows)
        changes = [_centered((one - found[0]) / spread, windows) for one in found[1:]]
        columns = np.stack(changes, axis=-1) / self._steps
        point = Point(values, robot, starts.copy(), residuals, [], [], np.full(len(windows), np.inf))
        steps = np.zeros_like(starts)
        for index in range(len(windows)):
            own = residuals[windows.rows_of(index)].reshape(-1)
            basis, triangle = np.linalg.qr(columns[windows.rows_of(index)].reshape(-1, len(self._steps)))
            point.bases.append(basis)
            point.triangles.append(triangle)
            if upright[:, index].all():
                point.costs[index] = own @ own
                steps[index] = np.linalg.lstsq(triangle, basis.T @ own, rcond=1e-12)[0]
        steps = _shortened(steps, TILT, MAX_TILT_STEP)
        return point, _shortened(steps, DEFLECTION, MAX_DEFLECTION_STEP)

    def derivatives(self, point: Point, noise: Mapping[str, float]) -> tuple[Array, Array]:
        """Derivatives with respect to the fitted numbers in units of their scales.

        Returns:
            Derivatives of the predicted measurements in standard deviations of the noise, projected off the effects of
            the starts, shape (m, channels, p); derivatives of the best starts, shape (w, n, p).

        Raises:
            ValueError: a number cannot be changed either way.
        """
        fitted, spread = self.fitted, self.spread(noise)
        found = np.zeros((*self._measured.shape, len(fitted.names)))
        moved: list[int] = []
        columns: list[Column] = []
        spans: list[float] = []
        for index in range(len(fitted.names)):
            bias = fitted.bias_of(index)
            if bias is not None:
                channel = SENSORS["gyro" if bias[0] == "gyro_bias" else "acceleration"].start + bias[1]
                found[:, channel, index] = fitted.scales[index] * self.used[:, channel]
                continue
            ends = []
            for sign in (1.0, -1.0):
                neighbor = point.values.copy()
                change = sign * DIFFERENCE * fitted.scales[index]
                neighbor[index] = np.clip(neighbor[index] + change, fitted.low[index], fitted.high[index])
                try:
                    robot = fitted.robot(neighbor, self._base)
                    self._simulator.check(robot)
                    columns.append(Column(robot, point.starts))
                except ValueError:
                    # A one-sided difference at the edge of the valid parameters.
                    neighbor = point.values
                    columns.append(Column(point.robot, point.starts))
                ends.append(neighbor[index])
            if ends[0] == ends[1]:
                raise InvalidInputError(
                    f"{fitted.names[index]} = {ends[0]:g} cannot be changed up or down: the changed robot would be "
                    "invalid; leave it out of fields"
                )
            moved.append(index)
            spans.append((ends[0] - ends[1]) / fitted.scales[index])
        if columns:
            read, _ = self._run(self.windows, np.ones(len(found), dtype=np.bool_), columns)
            found[..., moved] = np.moveaxis((read[0::2] - read[1::2]), 0, -1) / np.array(spans)
        found /= spread[:, None]
        for index in range(found.shape[-1]):
            found[..., index] = _centered(found[..., index], self.windows)
        tangents = np.zeros((*point.starts.shape, found.shape[-1]))
        for index, (basis, triangle) in enumerate(zip(point.bases, point.triangles, strict=True)):
            rows = self.windows.rows_of(index)
            own = found[rows].reshape(-1, found.shape[-1])
            shared = basis.T @ own
            tangents[index] = -np.linalg.lstsq(triangle, shared, rcond=1e-12)[0]
            found[rows] = (own - basis @ shared).reshape(found[rows].shape)
        return found, tangents

    def _run(self, windows: Windows, rows: Mask, columns: list[Column]) -> tuple[Array, Mask]:
        found, upright = self._simulator.run(windows, columns)
        self._called()
        return np.where(self.used[rows], found, 0.0), upright

    def leverage(self, point: Point, derivatives: Array, kept: Mask) -> Array:
        """Leverage of each measurement, shape (m, channels); they sum to the number of unknowns."""
        found = np.zeros(self._measured.shape)
        rows_of = np.diff(self.windows.bounds)
        found[:, SENSORS["wheel_angle"]] = (1.0 / rows_of)[self.windows.window][:, None]
        for index, basis in enumerate(point.bases):
            rows = self.windows.rows_of(index)
            found[rows] += (basis**2).sum(axis=1).reshape(found[rows].shape)
        chosen = kept[self.windows.window]
        flat = derivatives[chosen].reshape(-1, derivatives.shape[-1])
        basis = np.linalg.qr(flat)[0]
        found[chosen] += (basis**2).sum(axis=1).reshape(-1, self.channels)
        return np.asarray(found)


def _shortened(steps: Array, place: slice, longest: float) -> Array:
    """Steps of starts, shortened where some coordinates would move farther than this."""
    moved = np.abs(steps[:, place]).max(axis=1, keepdims=True, initial=0.0)
    return np.asarray(steps * np.minimum(1.0, longest / np.maximum(moved, 1e-300)))


def _centered(rows: Array, windows: Windows) -> Array:
    """Rows minus the mean of each window's wheel angles, whose origin is free."""
    place = SENSORS["wheel_angle"]
    sums = np.add.reduceat(rows[:, place], windows.bounds[:-1], axis=0)
    centered: Array = rows.copy()
    centered[:, place] -= (sums / np.diff(windows.bounds)[:, None])[windows.window]
    return centered
