"""A trajectory as named quantities with units, for tables, files and messages."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._payloads import NAMES
from ballbot_rs.control.setpoints import ALL_PARTS

if TYPE_CHECKING:
    from ballbot_rs.analysis.trajectory import Trajectory

Array = npt.NDArray[np.float64]

XYZ, XY, WXYZ, WHEELS, SCALAR = ("x", "y", "z"), ("x", "y"), ("w", "x", "y", "z"), ("0", "1", "2"), ()


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A quantity at all rows."""

    #: Its group: state, estimate, setpoint, torque, contacts, payload or draws.
    group: str
    name: str
    #: Names of its numbers; empty for one number.
    axes: tuple[str, ...]
    unit: str
    doc: str
    #: Shape (n, number of axes), or (n, 1) without axes; NaN where a value is missing.
    values: Array

    @property
    def titles(self) -> list[str]:
        """Names of its columns: quantity, axis and unit."""
        unit = _SUFFIXES[self.unit]
        return [f"{self.name}{axis}{unit}" for axis in ([f"_{axis}" for axis in self.axes] or [""])]


_SUFFIXES: Final = {
    "": "",
    "m": "_m",
    "m/s": "_m_per_s",
    "m/s²": "_m_per_s2",
    "m/s³": "_m_per_s3",
    "m/s⁴": "_m_per_s4",
    "rad": "_rad",
    "rad/s": "_rad_per_s",
    "N": "_N",
    "N·m": "_N_m",
}

#: Attribute of a state, axes, unit, description.
_STATE: Final[Sequence[tuple[str, tuple[str, ...], str, str]]] = (
    ("ball_position", XYZ, "m", "center of the ball, inertial frame"),
    ("ball_quaternion", WXYZ, "", "attitude of the ball, ball to inertial"),
    ("ball_velocity", XYZ, "m/s", "inertial frame"),
    ("ball_angular_velocity", XYZ, "rad/s", "inertial frame"),
    ("body_position", XYZ, "m", "origin of the body frame, inertial frame"),
    ("body_quaternion", WXYZ, "", "attitude of the body, body to inertial"),
    ("body_velocity", XYZ, "m/s", "inertial frame"),
    ("body_angular_velocity", XYZ, "rad/s", "body frame"),
    ("wheel_angles", WHEELS, "rad", "relative to the body, about the axles"),
    ("wheel_speeds", WHEELS, "rad/s", "relative to the body, about the axles"),
    ("tilt", SCALAR, "rad", "angle between mast and vertical"),
    ("tilt_components", XY, "rad", "rotation vector that takes the vertical to the mast"),
    ("yaw", SCALAR, "rad", "heading"),
)
#: The same for contacts.
_CONTACTS: Final[Sequence[tuple[str, tuple[str, ...], str, str]]] = (
    ("wheel_normal_forces", WHEELS, "N", "load of a wheel on the ball, in the previous time step"),
    ("wheel_tractions", WHEELS, "N", "traction of a wheel on the ball, in the previous time step"),
    ("wheel_slip_speeds", WHEELS, "m/s", "of a wheel relative to the ball, in the previous time step"),
    ("floor_force", XYZ, "N", "of the floor on the ball, inertial frame, in the previous time step"),
    ("bot_floor_force", XYZ, "N", "of the floor on body and wheels, inertial frame, in the previous time step"),
    ("friction_utilization", ("0", "1", "2", "floor"), "", "fraction of the dynamic friction limit in use"),
)
#: The same where there are obstacles.
_OBSTACLES: Final = ("obstacle_force", XYZ, "N", "of obstacles on ball, body and wheels, inertial frame, likewise")
#: Deflections of a payload, in the order of `Batch.payloads`.
_PAYLOAD: Final[Sequence[tuple[str, tuple[str, ...], str, str]]] = (
    ("deflection", XYZ, "m", "of the payload from its place, body axes"),
    ("deflection_rate", XYZ, "m/s", "as the body sees it, body axes"),
)
#: Unit and description of a part of a setpoint.
_SETPOINT: Final = {
    "position": ("m", "of the ball, inertial frame"),
    "velocity": ("m/s", "inertial frame"),
    "acceleration": ("m/s²", "of the flat output, inertial frame"),
    "jerk": ("m/s³", "of the flat output, inertial frame"),
    "snap": ("m/s⁴", "of the flat output, inertial frame"),
    "yaw": ("rad", "heading"),
    "yaw_rate": ("rad/s", "rate of the heading"),
    "tilt": ("rad", "heading frame"),
}


def quantities(trajectory: "Trajectory") -> Iterator[Quantity]:
    """All quantities of a trajectory except the time."""
    rows = len(trajectory.times)
    for name, axes, unit, doc in _STATE:
        yield Quantity("state", name, axes, unit, doc, _rows(trajectory.of_states(name), rows))
    yield Quantity(
        "torque", "wheel_torque", WHEELS, "N·m", "as commanded, from the row to the next", trajectory.torques
    )
    for part, values in trajectory.setpoints.items():
        unit, doc = _SETPOINT[part]
        axes = XY if ALL_PARTS[part] == 2 else SCALAR
        yield Quantity("setpoint", f"setpoint_{part}", axes, unit, doc, _rows(values, rows))
    has_obstacles = trajectory.terrain is not None and trajectory.terrain.obstacles
    for name, axes, unit, doc in (*_CONTACTS, _OBSTACLES) if has_obstacles else _CONTACTS:
        yield Quantity("contacts", name, axes, unit, doc, _rows(trajectory.of_contacts(name), rows))
    if len(trajectory.payloads):
        for index, payload in enumerate(NAMES):
            deflections = trajectory.payloads[:, index]
            # A robot may be unloaded in the end.
            if getattr(trajectory.params, f"{payload}_mass") > 0.0 or deflections.any():
                for (what, axes, unit, doc), values in zip(_PAYLOAD, np.split(deflections, 2, axis=1), strict=True):
                    yield Quantity("payload", f"{payload}_{what}", axes, unit, doc, _rows(values, rows))
    if trajectory.estimates:
        for name, axes, unit, doc in _STATE:
            values = _rows(trajectory.of_estimates(name), rows)
            yield Quantity("estimate", f"estimated_{name}", axes, unit, f"as the task observes it: {doc}", values)
    for term, drawn in trajectory.draws.items():
        values = _rows(drawn, rows)
        axes = tuple(str(i) for i in range(values.shape[1])) if drawn.ndim > 1 else SCALAR
        yield Quantity("draws", f"drawn_{term.replace('.', '_')}", axes, "", "sampled by events, SI units", values)


def columns(trajectory: "Trajectory") -> dict[str, Array]:
    """Columns by name, shape (n,) each, `time_s` first."""
    found = {"time_s": trajectory.times}
    for quantity in quantities(trajectory):
        found.update(zip(quantity.titles, quantity.values.T, strict=True))
    return {name: column.copy() for name, column in found.items()}


def _rows(values: Array, count: int) -> Array:
    """Rows of numbers, with NaN after the last row."""
    numbers = np.asarray(values, dtype=np.float64)
    numbers = numbers.reshape(len(numbers), -1)
    missing = np.full((count - len(numbers), numbers.shape[1]), np.nan)
    return np.concatenate([numbers, missing]) if len(missing) else numbers
