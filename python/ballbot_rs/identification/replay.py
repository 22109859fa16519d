"""A log compared with a simulation: short windows under the logged torques, each from the start that fits it best."""

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import keep_copies
from ballbot_rs._core import Params
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.identification import starts as starts_of
from ballbot_rs.identification.log import COLUMNS, UNITS, SensorLog
from ballbot_rs.identification.noise import first_guess
from ballbot_rs.identification.parameters import NOTHING
from ballbot_rs.identification.problem import Problem
from ballbot_rs.identification.setup import prepare
from ballbot_rs.identification.simulation import SENSORS, measured
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Columns of the sensors, in the order of `simulation.SENSORS`.
TITLES: Final = (*COLUMNS["wheel_angles"], *COLUMNS["gyro"], *COLUMNS["accelerations"])
#: Simulations of the windows in a usual replay, for the progress.
USUAL: Final = 10
#: Windows that are simulated at once: more take more memory, but hardly less time.
GROUP: Final = 250


@dataclasses.dataclass(frozen=True)
class Residual:
    """Measured minus simulated values of one column, over all windows that did not fall."""

    column: str
    unit: str
    #: Root mean square of the measured values minus their mean in each window.
    measured: float
    #: Root mean square of the residuals.
    rms: float
    #: Standard deviation of the noise, from third differences of the measurements.
    noise: float

    @property
    def explained(self) -> float:
        """Fraction of the measured changes' mean square that the simulation explains; below 0 it is worse than none."""
        return 1.0 - (self.rms / self.measured) ** 2 if self.measured > 0.0 else 0.0


@dataclasses.dataclass(frozen=True, repr=False)
class Replay:
    """A log and its simulation; m rows in w windows. Rows of windows that fell are NaN in `simulated`."""

    log: SensorLog
    params: Params
    model: str
    sim_dt: float
    windows: Windows
    #: Time of each row, s of the log, shape (m,).
    time: Array
    #: Measured and simulated wheel angles, body rates and, if logged, specific forces, shape (m, 6) or (m, 9). Origins
    #: of wheel angles are of the measurement; the specific force of a window's first row is NaN.
    measured: Array
    simulated: Array
    #: Tilt about x and y, heading frame, rad, shape (m, 2): integrals of the measured and the simulated body rates from
    #: the start of each window.
    measured_tilt: Array
    simulated_tilt: Array
    residuals: tuple[Residual, ...]
    #: Root mean square residual of each sensor in each window, in standard deviations of its noise, shape (w,).
    of_windows: Mapping[str, Array]
    #: Windows in which the simulated robot fell.
    fallen: int

    def __post_init__(self) -> None:
        keep_copies(self)

    @property
    def measured_speeds(self) -> Array:
        """Speeds of the wheels from differences of the measured angles, rad/s, shape (m, 3); NaN in first rows."""
        return self._speeds(self.measured)

    @property
    def simulated_speeds(self) -> Array:
        """Speeds of the wheels from differences of the simulated angles, rad/s, shape (m, 3); NaN in first rows."""
        return self._speeds(self.simulated)

    def _speeds(self, rows: Array) -> Array:
        speeds = np.full((len(rows), 3), np.nan)
        speeds[1:] = np.diff(rows[:, SENSORS["wheel_angle"]], axis=0) / np.diff(self.time)[:, None]
        speeds[self.windows.bounds[:-1]] = np.nan
        return speeds

    def to_dict(self) -> dict[str, Any]:
        """Residuals and windows as plain numbers, lists and dicts."""
        worst = {
            name: int(np.nanargmax(values)) for name, values in self.of_windows.items() if np.isfinite(values).any()
        }
        return {
            "log": None if self.log.report is None else self.log.report.to_dict(),
            "model": self.model,
            "sim_dt": self.sim_dt,
            "windows": len(self.windows),
            "fallen": self.fallen,
            "residuals": [{**dataclasses.asdict(one), "explained": one.explained} for one in self.residuals],
            "worst_windows": {
                name: {"begins": self.begins[index], "rms_over_noise": float(self.of_windows[name][index])}
                for name, index in worst.items()
            },
        }

    @property
    def begins(self) -> list[float]:
        """Time of each window's first row, s of the log."""
        return [float(one) for one in self.time[self.windows.bounds[:-1]]]

    def table(self) -> str:
        """Residuals by column as text."""
        header = ("column", "unit", "measured rms", "residual rms", "noise", "explained")
        rows = [
            (
                one.column,
                one.unit,
                f"{one.measured:.3g}",
                f"{one.rms:.3g}",
                f"{one.noise:.2g}",
                f"{100 * one.explained:.1f} %",
            )
            for one in self.residuals
        ]
        widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
        lines = [
            "  ".join(
                cell.ljust(width) if i < 2 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            )
            for row in (header, *rows)
        ]
        lines.append("")
        lines.append(f"{len(self.windows)} windows of {self.windows.steps * self.sim_dt:g} s, {self.fallen} fell.")
        for name, worst in self.to_dict()["worst_windows"].items():
            lines.append(
                f"Worst window of {name}: at {worst['begins']:.2f} s, {worst['rms_over_noise']:.3g} times its noise."
            )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Replay of {len(self.windows)} windows with the model {self.model}>"

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(self.table())}</pre>"


def replay(
    log: SensorLog | str | PathLike[str],
    params: Params | str | PathLike[str] | None = None,
    *,
    actuators: Mapping[str, Any] | str | None = None,
    model: Literal["spatial", "contact", "rigid"] | str = "contact",
    sim_dt: float = 0.002,
    window: float = 0.5,
    imu_position: Sequence[float] = (0.0, 0.0, 0.0),
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> Replay:
    """Simulates a robot under the torques of a log, and compares it with the log's measurements.

    A balancing robot diverges in open loop, so the log is divided into windows, each simulated from the tilt, rates,
    velocity and spin that fit its measurements best, as `identify` does.

    Args:
        log: the log, or the path of its file, as `SensorLog.read` takes it.
        params: the robot; None is the paper's.
        actuators: its motors, as `actuators=` of an environment, with only delay, lag and strengths; None is ideal.
        model: of the simulation: `spatial`, `contact` or `rigid`.
        sim_dt: time step of the model, s, at most the log's median step.
        window: length of a window, s, from 0.05 to 2.
        imu_position: place of the accelerometer in the body frame, m.
        num_threads: of the simulations; None takes all cores.
        progress: called with the number of simulations of all windows done, and the expected number.

    Raises:
        ValueError: a bad log or argument, columns whose units or signs contradict each other, or a log in which all
            windows fall.
        OSError: a file cannot be read.
        KeyboardInterrupt: Ctrl-C.
    """
    log, base, windows, simulator = prepare(
        log,
        params,
        actuators,
        model=model,
        sim_dt=sim_dt,
        window=window,
        imu_position=imu_position,
        num_threads=num_threads,
    )
    count, groups = 0, -(-len(windows) // GROUP)

    def called() -> None:
        nonlocal count
        count += 1
        progress(count, max(USUAL * groups, count + 1))

    spreads = first_guess(log)
    starts = starts_of.estimated(log, windows, base.params)
    standing = np.zeros(len(windows), dtype=np.bool_)
    parts = []
    for group in range(groups):
        chosen = np.arange(len(windows)) // GROUP == group
        problem = Problem(log, windows.subset(chosen), simulator, NOTHING, base, called)
        point = problem.at(NOTHING.start, starts[chosen], spreads)
        starts[chosen], standing[chosen] = point.starts, np.isfinite(point.costs)
        usable = problem.used & standing[chosen][problem.windows.window][:, None]
        parts.append(np.where(usable, point.residuals * problem.spread(spreads), np.nan))
    progress(count, count)
    if not standing.any():
        raise InvalidInputError(
            f"the simulated robot falls in all {len(windows)} windows: the robot's parameters or the log are wrong"
        )
    rows, differences = measured(log, windows), np.concatenate(parts)
    rows[windows.bounds[:-1], SENSORS["acceleration"]] = np.nan
    simulated, gyro = rows - differences, SENSORS["gyro"]
    return Replay(
        log=log,
        params=base.params,
        model=model,
        sim_dt=sim_dt,
        windows=windows,
        time=log.time[windows.rows],
        measured=rows,
        simulated=simulated,
        measured_tilt=_tilts(log, windows, starts, rows[:, gyro]),
        simulated_tilt=_tilts(log, windows, starts, simulated[:, gyro]),
        residuals=_residuals(rows, differences, windows, log),
        of_windows=_of_windows(differences, windows, spreads),
        fallen=int((~standing).sum()),
    )


def _residuals(rows: Array, differences: Array, windows: Windows, log: SensorLog) -> tuple[Residual, ...]:
    usable = np.isfinite(differences)
    counts = np.maximum(np.add.reduceat(usable, windows.bounds[:-1], axis=0, dtype=np.int64), 1)
    means = np.add.reduceat(np.where(usable, rows, 0.0), windows.bounds[:-1], axis=0) / counts
    changes = np.where(usable, rows - means[windows.window], np.nan)
    own, rest = (np.sqrt(np.nanmean(one**2, axis=0)) for one in (changes, differences))
    noise = {name: np.sqrt((np.diff(values, n=3, axis=0) ** 2).mean(axis=0) / 20.0) for name, values in _series(log)}
    found = []
    for name, place in SENSORS.items():
        if place.stop <= rows.shape[1]:
            for axis, index in enumerate(range(place.start, place.stop)):
                numbers = (float(own[index]), float(rest[index]), float(noise[name][axis]))
                found.append(Residual(TITLES[index], UNITS[name], *numbers))
    return tuple(found)


def _series(log: SensorLog) -> list[tuple[str, Array]]:
    series = (("wheel_angle", log.wheel_angles), ("gyro", log.gyro), ("acceleration", log.accelerations))
    return [(name, values) for name, values in series if values is not None]


def _of_windows(differences: Array, windows: Windows, spreads: Mapping[str, float]) -> dict[str, Array]:
    found = {}
    for name, spread in spreads.items():
        own = differences[:, SENSORS[name]]
        usable = np.isfinite(own)
        sums = np.add.reduceat(np.where(usable, own, 0.0) ** 2, windows.bounds[:-1], axis=0).sum(axis=1)
        counts = np.add.reduceat(usable, windows.bounds[:-1], axis=0, dtype=np.int64).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            found[name] = np.sqrt(sums / counts) / spread
    return found


def _tilts(log: SensorLog, windows: Windows, starts: Array, rates: Array) -> Array:
    """Tilts about x and y, heading frame, rad, shape (m, 2): integrals of body rates from each window's start."""
    found = np.full((len(rates), 2), np.nan)
    time, first, sizes = log.time[windows.rows], windows.bounds[:-1], np.diff(windows.bounds)
    angle = np.linalg.norm(starts[:, :2], axis=1)
    across = starts[:, :2] * np.sinc(angle / np.pi)[:, None]
    # The vertical in the body frame.
    up = np.stack([-across[:, 1], across[:, 0], np.cos(angle)], axis=-1)
    for place in range(int(sizes.max())):
        chosen = place < sizes
        row = first[chosen] + place
        if place:
            turn = -0.5 * (rates[row] + rates[row - 1]) * (time[row] - time[row - 1])[:, None]
            up[chosen] = _turned(up[chosen], turn)
        sine = np.hypot(up[chosen, 0], up[chosen, 1])
        scale = np.arctan2(sine, up[chosen, 2]) / np.maximum(sine, 1e-300)
        found[row] = np.stack([up[chosen, 1], -up[chosen, 0]], axis=-1) * scale[:, None]
    return found


def _turned(vectors: Array, turns: Array) -> Array:
    """Vectors turned by rotation vectors, both (n, 3)."""
    angle = np.linalg.norm(turns, axis=1, keepdims=True)
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    once = np.cross(turns, vectors)
    return np.asarray(vectors + sine * once + versine * np.cross(turns, once))
