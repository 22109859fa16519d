"""A log compared with a simulation: short windows under the logged torques, each from the start that fits it best."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import keep_copies
from ballbot_rs._core import Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._robot import Robot
from ballbot_rs._state_rows import (
    BALL_POSITION,
    BALL_QUATERNION,
    BALL_VELOCITY,
    BODY_POSITION,
    BODY_QUATERNION,
    BODY_RATE,
    BODY_VELOCITY,
    WHEEL_ANGLES,
    WHEEL_SPEEDS,
)
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.identification import starts as starts_of
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.noise import first_guess
from ballbot_rs.identification.parameters import NOTHING
from ballbot_rs.identification.poses import Poses, compared
from ballbot_rs.identification.problem import Problem
from ballbot_rs.identification.residuals import Residual, by_window, of_poses, of_sensors
from ballbot_rs.identification.setup import prepare
from ballbot_rs.identification.simulation import SENSORS, measured
from ballbot_rs.identification.windows import Windows

Array = npt.NDArray[np.float64]

#: Simulations of the windows in a usual replay, for the progress.
USUAL: Final = 10
#: Windows that are simulated at once: more take more memory, but hardly less time.
GROUP: Final = 250


@dataclasses.dataclass(frozen=True, repr=False)
class Replay:
    """A log and its simulation; m rows in w windows.

    ```python
    found = bb.replay(bb.record_log(seconds=2.0))
    for residual in found.residuals:
        print(residual)
    ```

    Rows of windows that fell are NaN in `simulated`.
    """

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
    #: Logged poses, or else estimates from the measurements, and poses of the simulation, which begins each window in
    #: the measured position and heading, with the fitted tilt.
    measured_poses: Poses
    simulated_poses: Poses
    residuals: tuple[Residual, ...]
    #: Root mean square residual of each sensor in each window, in standard deviations of its noise, shape (w,).
    of_windows: Mapping[str, Array]
    #: Windows in which the simulated robot fell.
    fallen: int

    def __post_init__(self) -> None:
        keep_copies(self)

    @property
    def measured_tilt(self) -> Array:
        """Tilt about x and y, heading frame, rad, shape (m, 2)."""
        return self.measured_poses.tilt

    @property
    def simulated_tilt(self) -> Array:
        """As `measured_tilt`."""
        return self.simulated_poses.tilt

    @property
    def measured_speeds(self) -> Array:
        """Speeds of the wheels from differences of the measured angles, rad/s, shape (m, 3); NaN in first rows."""
        return self._speeds(self.measured)

    @property
    def simulated_speeds(self) -> Array:
        """Speeds of the wheels from differences of the simulated angles, rad/s, shape (m, 3); NaN in first rows."""
        return self._speeds(self.simulated)

    def trajectories(self, begin: float | None = None, seconds: float | None = None) -> tuple[Trajectory, Trajectory]:
        """Measured and simulated motion of a span, as trajectories of two robots without forces.

        Where the simulated robot fell, its rows are the measured motion.

        Args:
            begin: of the span, s of the log; None is the first row.
            seconds: duration of the span; None is up to the last row.

        Raises:
            ValueError: a span of fewer than two rows.
        """
        first = float(self.time[0]) if begin is None else begin
        last = np.inf if seconds is None else first + seconds
        shown = np.flatnonzero((self.time >= first) & (self.time <= last))
        if len(shown) < 2:
            raise InvalidInputError(
                f"{len(shown)} rows from {first:g} to {last:g} s, at least 2 are needed: the windows span "
                f"{self.time[0]:g} to {self.time[-1]:g} s"
            )
        measured = self._states(self.measured, self.measured_poses, shown)
        simulated = self._states(self.simulated, self.simulated_poses, shown)
        fell = ~np.isfinite(simulated).all(axis=1)
        simulated[fell] = measured[fell]
        torques = self.log.torques[self.windows.rows[shown]]
        names = (("measured", "the robot", measured), ("simulated", self.model, simulated))
        found = [
            Trajectory(
                controller=name,
                model=model,
                params=self.params,
                times=self.time[shown] - self.time[shown[0]],
                states=[State.from_array(row) for row in states],
                contacts=[],
                torques=torques,
                draws={},
                estimates=[],
                fell_at=None,
                setpoints={},
            )
            for name, model, states in names
        ]
        return found[0], found[1]

    def _states(self, rows: Array, poses: Poses, shown: npt.NDArray[np.int64]) -> Array:
        """Rows as `State.to_array`, with the velocities of differences."""
        states = np.zeros((len(shown), 32))
        states[:, BALL_POSITION] = np.insert(poses.position[shown], 2, self.params.ball_radius, axis=1)
        states[:, BODY_POSITION] = states[:, BALL_POSITION]
        states[:, BALL_QUATERNION], states[:, BODY_QUATERNION] = poses.ball_attitude[shown], poses.attitude[shown]
        velocity = np.diff(states[:, BALL_POSITION], axis=0) / np.diff(self.time[shown])[:, None]
        states[1:, BALL_VELOCITY] = states[1:, BODY_VELOCITY] = velocity
        states[:, BODY_RATE] = rows[shown, SENSORS["gyro"]]
        states[:, WHEEL_ANGLES] = rows[shown, SENSORS["wheel_angle"]]
        states[:, WHEEL_SPEEDS] = np.nan_to_num(self._speeds(rows)[shown])
        return states

    def record(
        self, path: str | PathLike[str], begin: float | None = None, seconds: float = 4.0, **options: Any
    ) -> int:
        """Writes a video or an animation of a span, measured next to simulated; returns the number of its frames.

        Args:
            path: the file; its name ends in .mp4 or .webp.
            begin: of the span, s of the log; None is the first row.
            seconds: duration of the span.
            options: as in `ballbot_rs.media.video.write_video`.

        Raises:
            ModuleNotFoundError: moviepy is not installed.
            ValueError: a span of fewer than two rows, another suffix, or an option out of range.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        from ballbot_rs.media.video import write_video

        return write_video(self.trajectories(begin, seconds), Path(path), **options)

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


@named
def replay(
    log: SensorLog | str | PathLike[str],
    robot: Robot | None = None,
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

    ```python
    log = bb.record_log(bb.Params.paper().replace(body_mass=2.4), seconds=2.0)
    print(bb.replay(log, "paper"))
    ```

    A balancing robot diverges in open loop, so the log is divided into windows, each simulated from the tilt, rates,
    velocity and spin that fit its measurements best, as `identify` does.

    Args:
        log: the log, or the path of its file, as `SensorLog.read` takes it.
        robot: as in `simulate`; None is the paper's.
        actuators: its motors, as `actuators=` of an environment, with only delay, lag and strengths; None is ideal.
        model: of the simulation: `spatial`, `contact` or `rigid`.
        sim_dt: time step of the model, s, at most the log's median step.
        window: length of a window, s, from 0.05 to 2.
        imu_position: position of the accelerometer in the body frame, m.
        num_threads: of the simulations; None uses all cores.
        progress: called with the number of simulations of all windows done, and the expected number.

    Raises:
        ValueError: a bad log or argument, columns whose units or signs contradict each other, or a log in which all
            windows fall.
        OSError: a file cannot be read.
        ModuleNotFoundError: as `SensorLog.read`.
        KeyboardInterrupt: Ctrl-C.
    """
    log, base, windows, simulator = prepare(log, robot, actuators, model, sim_dt, window, imu_position, num_threads)
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
    simulated = rows - differences
    poses = compared(log, base.params, windows, starts[:, :2], rows, simulated)
    return Replay(
        log=log,
        params=base.params,
        model=model,
        sim_dt=sim_dt,
        windows=windows,
        time=log.time[windows.rows],
        measured=rows,
        simulated=simulated,
        measured_poses=poses[0],
        simulated_poses=poses[1],
        residuals=(*of_sensors(rows, differences, windows, log), *of_poses(poses, windows, log)),
        of_windows=by_window(differences, windows, spreads),
        fallen=int((~standing).sum()),
    )
