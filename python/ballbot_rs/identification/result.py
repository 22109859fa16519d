"""Result of an identification."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs.identification.logs.log import UNITS
from ballbot_rs.identification.parameters import unit_of

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, repr=False)
class IdentifiedParams:
    """A robot that explains a log, with the uncertainty of each fitted number.

    ```python
    log = bb.record_log(seconds=4.0)
    found = bb.identify(log, fields=["body_mass"], sim_dt=0.005)
    print(found.params.body_mass, found.interval("body_mass"))
    ```

    Vectors count as their components: `body_inertia` is `body_inertia_xx`, `body_inertia_yy` and `body_inertia_zz`.
    """

    #: The robot.
    params: Params
    #: Options of its motors, as `actuators=` takes them: the delay is rounded to whole model steps.
    actuators: Mapping[str, Any]
    #: Constant error of the gyroscope, body frame, rad/s; zero unless fitted.
    gyro_bias: tuple[float, float, float]
    #: Constant error of the accelerometer, body frame, m/s²; zero unless fitted.
    acc_bias: tuple[float, float, float]
    #: Names of the p fitted numbers.
    names: tuple[str, ...]
    #: Unit of each.
    units: tuple[str, ...]
    #: Shape (p,).
    values: Array
    #: Standard deviation of each, shape (p,).
    standard_errors: Array
    #: Correlation coefficients, shape (p, p).
    correlation: Array
    #: Bounds of the 95 % intervals, shape (p, 2).
    intervals: Array
    #: Values of the robot that the fit started from, shape (p,).
    nominal: Array
    #: Numbers that the fit left at a limit, such as a friction of zero; their intervals have no meaning.
    at_limit: tuple[str, ...]
    #: Ratio of largest to smallest singular value of the derivatives, each number in units of its typical size.
    condition_number: float
    #: Standard deviation of the noise of each sensor: wheel_angle (rad), gyro (rad/s), acceleration (m/s²).
    noise: Mapping[str, float]
    #: Start and end of the windows that no robot explains, due to wheel slip or a push, s of the log.
    rejected: tuple[tuple[float, float], ...]
    #: Number of windows in the log.
    windows: int
    #: Number of measurements behind the result.
    measurements: int
    #: Model of the simulations.
    model: str
    #: Its time step, s.
    sim_dt: float

    def interval(self, name: str) -> tuple[float, float]:
        """The 95 % interval of a number.

        Raises:
            KeyError: it was not fitted.
        """
        if name not in self.names:
            raise KeyError(f"{name} was not fitted: there are {', '.join(self.names)}")
        low, high = self.intervals[self.names.index(name)].tolist()
        return low, high

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and dicts."""
        rows = zip(self.names, self.units, self.values, self.standard_errors, self.intervals, self.nominal, strict=True)
        return {
            "params": self.params.to_dict(),
            "actuators": dict(self.actuators),
            "gyro_bias": list(self.gyro_bias),
            "acc_bias": list(self.acc_bias),
            "fitted": {
                name: {
                    "unit": unit,
                    "value": float(value),
                    "standard_error": float(error),
                    "interval": [float(end) for end in ends],
                    "nominal": float(nominal),
                }
                for name, unit, value, error, ends, nominal in rows
            },
            "at_limit": list(self.at_limit),
            "correlation": self.correlation.tolist(),
            "condition_number": self.condition_number,
            "noise": dict(self.noise),
            "rejected": [list(one) for one in self.rejected],
            "windows": self.windows,
            "measurements": self.measurements,
            "model": self.model,
            "sim_dt": self.sim_dt,
        }

    def to_toml(self) -> str:
        """A robot's TOML file, for `--robot FILE` and `Params.from_toml`.

        Comments list the fitted numbers with their intervals. Motors that are fitted or not ideal are its table
        `[actuators]`, for `--actuators FILE`.
        """
        lines = [f"# Identified from {self.measurements} measurements; 95 % intervals."]
        lines += [f"# {line}" for line in self.table().splitlines()]
        lines += ["", self.params.to_toml().strip()]
        if self.actuators:
            lines += ["", "[actuators]"]
            for name, value in self.actuators.items():
                lines.append(f"{name} = {list(value) if isinstance(value, (tuple, list)) else value!r}")
        return "\n".join(lines) + "\n"

    def __repr__(self) -> str:
        found = ", ".join(f"{name}={value:.4g}" for name, value in zip(self.names, self.values, strict=True))
        return f"<IdentifiedParams from {self.measurements} measurements: {found}>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.table())}</pre>"

    def table(self) -> str:
        """One line per number: nominal value, estimate, half interval, unit; then residual noise and rejections."""
        head = ["parameter", "nominal", "estimate", "± 95 %", "unit"]
        rows = [head]
        for i, name in enumerate(self.names):
            half = float(self.intervals[i, 1] - self.intervals[i, 0]) / 2.0
            digits = 6 if half <= 0.0 else max(0, 1 - math.floor(math.log10(half)))
            cells = [f"{value:.{min(digits, 12)}f}" for value in (self.nominal[i], self.values[i])]
            margin = "at limit" if name in self.at_limit else f"{half:.2g}"
            rows.append([name, *cells, margin, self.units[i]])
        widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
        lines = []
        for row in rows:
            middle = [cell.rjust(width) for cell, width in zip(row[1:4], widths[1:4], strict=True)]
            lines.append("  ".join([row[0].ljust(widths[0]), *middle, row[4]]).rstrip())
        noise = ", ".join(f"{name} {value:.2g} {UNITS[name]}" for name, value in self.noise.items())
        lines += ["", f"residual noise (standard deviation): {noise}"]
        lines.append(f"rejected windows, which the model does not explain: {len(self.rejected)} of {self.windows}")
        lines += [f"  {begin:.2f} to {end:.2f} s" for begin, end in self.rejected]
        return "\n".join(lines)


def units_of(places: tuple[tuple[str, int | None], ...]) -> tuple[str, ...]:
    """Unit of each fitted number."""
    return tuple(unit_of(field) for field, _ in places)


def actuators_of(fields: tuple[str, ...], motors: Any, sim_dt: float) -> dict[str, Any]:
    """Options of the motors that are fitted or not ideal, the delay a whole number of model steps."""
    options = {
        "delay": round(round(motors.delay / sim_dt) * sim_dt, 12),
        "strength": list(motors.strength),
        "lag": motors.lag,
    }
    ideal = {"delay": 0.0, "strength": [1.0, 1.0, 1.0], "lag": 0.0}
    return {name: value for name, value in options.items() if name in fields or value != ideal[name]}
