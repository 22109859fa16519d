"""One robot under one controller: states, contacts and torques over time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import keep_copies
from ballbot_rs._core import Contacts, Params, State, Terrain
from ballbot_rs._extras import require
from ballbot_rs._state_rows import tilt_of
from ballbot_rs.analysis import columns, exports
from ballbot_rs.analysis import metrics as numbers
from ballbot_rs.analysis.metrics import Metrics
from ballbot_rs.analysis.pushes import Force, Push

if TYPE_CHECKING:
    from ballbot_rs.media.notebook import Animation

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, repr=False)
class Trajectory:
    """One row per controller decision; torques are held from one row to the next.

    ```python
    path = bb.simulate("lqr", tilt=(0.05, 0.0), pushes=bb.Push((0.3, 0.0, 0.0)), seconds=3.0)
    print(path.metrics().tilt_max, path.fell_at)
    path.write("path.csv")
    ```

    Its arrays are read-only.

    Shown as a table and a figure in a notebook. Quaternions are (w, x, y, z) and map body, or ball, to inertial.
    """

    controller: str
    model: str
    params: Params
    #: s, shape (n,).
    times: Array
    states: Sequence[State]
    #: Forces during the time step before the row.
    contacts: Sequence[Contacts]
    #: Wheel torques, as commanded, N·m, shape (n, 3); the last row repeats the row before.
    torques: Array
    #: Samples of the events at each row, by term, shape (n,) or (n, k), as `Batch.draws`; NaN before the first sample.
    #: Empty without events.
    draws: Mapping[str, Array]
    #: States as the task observes them, up to a fall; empty where it observes the true states.
    estimates: Sequence[State]
    #: Time at which the robot counted as fallen and its motors were switched off, s; None if it never did.
    fell_at: float | None
    #: The setpoint to follow, by part, shape (n, 2) or (n,); without a reference the task's setpoint for a law.
    setpoints: Mapping[str, Array]
    #: The ground; None is level.
    terrain: Terrain | None = None
    #: Requested impulses and forces on the body.
    pushes: Sequence[Push] = ()
    forces: Sequence[Force] = ()
    #: Largest torque of a wheel, N·m; None is unknown.
    max_wheel_torque: float | None = None
    #: Command of the task at each row up to a fall, as `Batch.command`, shape (m, k); k is 0 without.
    commands: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    #: Deflections of the payloads at each row, as `Batch.payloads`, shape (n, 2, 6); shape (0, 2, 6) without a payload.
    payloads: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 2, 6)))
    #: Name of the task.
    task: str = "balance"
    #: Time between two decisions of the controller, and time step of the model, s: the option `sim_dt`, or less where
    #: the controller's period is not a multiple of it; None is unknown.
    control_dt: float | None = None
    sim_dt: float | None = None
    #: Tilt from the equilibrium beyond which the task counts the robot as fallen, rad; None is another condition.
    fall_tilt: float | None = None
    #: Pushes of events and of the task, taken from the draws.
    drawn_pushes: Sequence[Push] = ()

    def __post_init__(self) -> None:
        keep_copies(self)

    @property
    def all_pushes(self) -> Sequence[Push]:
        """Requested and sampled pushes."""
        return (*self.pushes, *self.drawn_pushes)

    def __repr__(self) -> str:
        ending = "upright" if self.fell_at is None else f"fell at {self.fell_at:g} s{self._began_fallen}"
        steps = "" if self.sim_dt is None else f", sim_dt {1e3 * self.sim_dt:.4g} ms"
        return (
            f"<Trajectory of {self.controller} on {self.model}: {self.times[-1]:g} s, {len(self.times)} rows, "
            f"{ending}{steps}>"
        )

    @property
    def _began_fallen(self) -> str:
        """Why a robot fell that began beyond the limit of its task, or an empty text."""
        begun = float(tilt_of(self.states[0].to_array(), self.params.body_com))
        if self.fall_tilt is None or begun <= self.fall_tilt:
            return ""
        return f" as it began at {begun:.3g} rad, beyond the option fall_tilt = {self.fall_tilt:.3g} rad"

    def _repr_html_(self) -> str:
        from ballbot_rs.media.notebook import shown

        return shown(self)

    def of_states(self, name: str) -> Array:
        """An attribute of all states, for example `tilt`."""
        return np.array([getattr(state, name) for state in self.states])

    def of_estimates(self, name: str) -> Array:
        """An attribute of all estimates."""
        return np.array([getattr(state, name) for state in self.estimates])

    def of_contacts(self, name: str) -> Array:
        """An attribute of all contacts, for example `wheel_normal_forces`."""
        return np.array([getattr(contacts, name) for contacts in self.contacts])

    def to_array(self) -> Array:
        """All states, shape (n, 32), rows as `State.to_array`."""
        return np.array([state.to_array() for state in self.states])

    def metrics(self) -> Metrics:
        """Tilt, distance from the setpoint, torque and traction in numbers, until the robot fell."""
        return numbers.metrics(self)

    def columns(self) -> dict[str, Array]:
        """All quantities by names with their units, shape (n,) each, as in the files.

        Wheels are 0, 1, 2. Missing quantities are NaN: estimates after a fall, events not sampled yet.
        """
        return columns.columns(self)

    def to_dataframe(self) -> Any:
        """A `pandas.DataFrame` with the columns of `columns`.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        return exports.to_dataframe(self)

    def write(self, path: str | PathLike[str]) -> None:
        """Writes the file that its suffix names: as `to_csv`, `to_npz`, `to_mcap`, `to_parquet` or `to_html`.

        Raises:
            ValueError: another suffix.
            ModuleNotFoundError, OSError: as these.
        """
        exports.format_of(path)(self, Path(path))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Writes the columns of `columns` as CSV; numbers read back bit for bit.

        Raises:
            ValueError: a suffix other than .csv.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        exports.to_csv(self, path)

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Writes the columns of `columns` for `numpy.load`.

        Raises:
            ValueError: a suffix other than .npz.
            OSError: as `to_csv`.
        """
        exports.to_npz(self, path)

    def to_mcap(self, path: str | PathLike[str]) -> None:
        """Writes an MCAP log with JSON messages, for Foxglove and readers of MCAP.

        Topics are `/state`, `/torque`, `/setpoint`, `/contacts`, `/payload`, `/estimate`, `/draws` and, with the frames
        of ball and body in `world`, `/tf`. Schemas have the units.

        Raises:
            ModuleNotFoundError: mcap is not installed.
            ValueError: a suffix other than .mcap.
            OSError: as `to_csv`.
        """
        exports.to_mcap(self, path)

    def to_parquet(self, path: str | PathLike[str]) -> None:
        """Writes the columns of `columns` as a Parquet table, with controller, model and parameters as metadata.

        Raises:
            ModuleNotFoundError: pyarrow is not installed.
            ValueError: a suffix other than .parquet.
            OSError: as `to_csv`.
        """
        exports.to_parquet(self, path)

    def to_html(
        self, path: str | PathLike[str], *, frame_rate: float = 60.0, forces: bool = False, dark: bool = False
    ) -> None:
        """Writes one HTML file that replays the motion in 3D, as on the page of `ballbot view`, over its curves.

        The file loads nothing from elsewhere and needs a browser with WebGL. It has pushes, forces and the task's
        command, curves with a mark at the current time (if matplotlib is installed), the numbers of `metrics` and all
        parameters. Each of its frames is the nearest row.

        Args:
            path: the file.
            frame_rate: frames per second, 1 to 240.
            forces: whether arrows show the forces at the contacts.
            dark: whether the colors are dark.

        Raises:
            ModuleNotFoundError: viser is not installed.
            ValueError: a suffix other than .html, or a frame rate out of range.
            OSError: as `to_csv`.
        """
        exports.to_html(self, path, frame_rate=frame_rate, forces=forces, dark=dark)

    def plot(self, path: str | PathLike[str] | None = None, *, width: float | None = None) -> Any:
        """The matplotlib figure of tilt, position, torques, loads and friction over time.

        Args:
            path: the file to write, if any.
            width: of the figure, inches, for example 3.5 for one column of a paper.

        Raises:
            ModuleNotFoundError: matplotlib is not installed.
            ValueError: a suffix other than .svg, .pdf or .png, or a width out of range.
            OSError: as `to_csv`.
        """
        with require("a figure", "plot"):
            from ballbot_rs.media.figures import style, trajectories
        file = None if path is None else Path(path)
        if file is not None:
            style.check_suffix(file)
        drawn = trajectories.draw([self], width)
        if file is not None:
            style.save(drawn, file)
        return drawn

    def record(self, path: str | PathLike[str], **options: Any) -> int:
        """Writes a video (.mp4), an animation (.webp, .gif) or its frames (%04d.png); returns the number of frames.

        `options` as in `ballbot_rs.media.video.write_video`.

        Raises:
            ModuleNotFoundError: moviepy is not installed.
            ValueError: another suffix, or an option out of range.
            OSError: as `to_csv`.
        """
        from ballbot_rs.media.video import write_video

        return write_video(self, Path(path), **options)

    def animate(self, **options: Any) -> Animation:
        """A video that a notebook shows in its output, with controls.

        `options` as in `ballbot_rs.media.video.write_video`, as `frame_rate`, `forces` and `renderer`.

        Raises:
            ModuleNotFoundError: moviepy is not installed.
            ValueError: an option out of range.
        """
        from ballbot_rs.media.notebook import Animation

        return Animation.of(self, **options)
