"""Metrics of every episode of a scenario."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._state_rows import tilt_of
from ballbot_rs.analysis.settling import HOLD

Array = npt.NDArray[np.float64]

#: Names of the numbers of an episode, with units.
METRICS: Final = {
    "fell": "",
    "rms_tilt": "rad",
    "largest_tilt": "rad",
    "final_tilt": "rad",
    "rms_error": "m",
    "largest_error": "m",
    "final_error": "m",
    "rms_velocity_error": "m/s",
    "final_speed": "m/s",
    "largest_yaw_error": "rad",
    "final_yaw_error": "rad",
    "settling_time": "s",
    "recovery_time": "s",
    "rms_torque": "N·m",
    "largest_torque": "N·m",
    "torque_variation": "N·m/s",
    "energy": "J",
    "largest_traction": "",
    "slip": "m",
    "least_load": "N",
}

#: Tilt within which a robot has recovered unless the scenario has a final tilt, rad.
UPRIGHT: Final = float(np.deg2rad(2.0))

#: Tilt (rad), distance (m) and speed (m/s) within which a robot has settled.
_SETTLED: Final = (np.deg2rad(1.0), 0.02, 0.02)

_BALL_VELOCITY: Final = slice(7, 9)
_BODY_W, _BODY_Z = 16, 19
_WHEEL_SPEEDS: Final = slice(29, 32)


# NumPy's own reductions over an axis of three take several times as long.
def _length(vectors: Array) -> Array:
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def _sum(values: Array) -> Array:
    return np.asarray(values[..., 0] + values[..., 1] + values[..., 2])


def _largest(values: Array) -> Array:
    return np.asarray(np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2]))


class Measures:
    """Numbers of n episodes, gathered over chunks of control steps."""

    def __init__(
        self,
        n: int,
        control_dt: float,
        measure_from: float,
        com: Array,
        friction: Array,
        upright: float = UPRIGHT,
    ) -> None:
        self._dt = control_dt
        self._from, self._upright = measure_from, upright
        self._com = com
        self._friction = friction
        self._time = 0.0
        self._seconds = np.zeros(n)
        self._measured = np.zeros(n)
        self._squares = {name: np.zeros(n) for name in ("tilt", "error", "velocity", "torque")}
        self._largest = {name: np.zeros(n) for name in ("tilt", "error", "yaw", "torque", "traction")}
        self._last = {name: np.full(n, np.nan) for name in ("tilt", "error", "speed", "yaw")}
        self._variation, self._energy, self._slip = np.zeros(n), np.zeros(n), np.zeros(n)
        self._least_load = np.full(n, np.inf)
        self._unsettled, self._leaning = np.zeros(n), np.zeros(n)
        self._torques: Array | None = None
        self.fell = np.zeros(n, dtype=bool)

    def add(self, rows: dict[str, Array], position: Array, velocity: Array, yaw: Array) -> None:
        """Adds control steps.

        Args:
            rows: `states` before each step and after the last, shape (k + 1, n, 32), `torques` (k, n, 3), `terminated`
                (k, n); and, where they are known, `wheel_normal_forces`, `wheel_tractions`, `wheel_slip_speeds`,
                as the states.
            position: desired ball position at these times, shape (k + 1, n, 2) or (k + 1, 1, 2), m.
            velocity: desired ball velocity, m/s.
            yaw: desired heading of the body, shape (k + 1, n) or (k + 1, 1), rad.
        """
        states, torques = rows["states"], rows["torques"]
        ended = rows["terminated"].astype(bool)
        # An episode counts up to its end: the rows after each step that did not end it.
        alive = ~self.fell & ~np.logical_or.accumulate(ended, axis=0)
        after = states[1:]
        times = self._time + self._dt * np.arange(1, len(after) + 1)
        tilt = tilt_of(after, self._com)
        error = _length(after[..., :2] - position[1:])
        off = _length(after[..., _BALL_VELOCITY] - velocity[1:])
        speed = _length(after[..., _BALL_VELOCITY])
        turn = 2.0 * np.arctan2(after[..., _BODY_Z], after[..., _BODY_W]) - yaw[1:]
        turned = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        measured = alive & (times >= self._from - 1e-9)[:, None]
        squared_torque = _sum(torques**2) / 3.0
        largest_torque = _largest(np.abs(torques))
        for name, squares, mask in (
            ("tilt", tilt**2, measured),
            ("error", error**2, measured),
            ("velocity", off**2, measured),
            ("torque", squared_torque, alive),
        ):
            self._squares[name] += np.where(mask, squares, 0.0).sum(axis=0)
        for name, values, mask in (
            ("tilt", tilt, alive),
            ("error", error, measured),
            ("yaw", turned, measured),
            ("torque", largest_torque, alive),
        ):
            self._largest[name] = np.maximum(self._largest[name], np.where(mask, values, 0.0).max(axis=0))
        before = torques[:1] if self._torques is None else self._torques
        change = _sum(np.abs(np.diff(torques, axis=0, prepend=before)))
        self._variation += np.where(alive, change, 0.0).sum(axis=0)
        work = _sum(np.abs(torques * states[:-1][..., _WHEEL_SPEEDS])) * self._dt
        self._energy += np.where(alive, work, 0.0).sum(axis=0)
        settled = (tilt < _SETTLED[0]) & (error < _SETTLED[1]) & (speed < _SETTLED[2])
        self._unsettled = np.maximum(self._unsettled, np.where(alive & ~settled, times[:, None], 0.0).max(axis=0))
        self._leaning = np.maximum(
            self._leaning, np.where(alive & (tilt >= self._upright), times[:, None], 0.0).max(axis=0)
        )
        for name, values in (("tilt", tilt), ("error", error), ("speed", speed), ("yaw", turned)):
            self._last[name] = np.where(alive[-1], values[-1], self._last[name])
        if "wheel_normal_forces" in rows:
            self._add_contacts(rows, alive)
        self._seconds += alive.sum(axis=0) * self._dt
        self._measured += measured.sum(axis=0)
        self.fell |= ended.any(axis=0)
        self._torques = torques[-1:]
        self._time = float(times[-1])

    def _add_contacts(self, rows: dict[str, Array], alive: npt.NDArray[np.bool_]) -> None:
        loads, tractions = rows["wheel_normal_forces"][1:], rows["wheel_tractions"][1:]
        friction = self._friction[:, None]
        shares = np.abs(tractions) / np.maximum(friction * loads, 1e-9)
        shares = _largest(np.where(loads > 0.0, np.minimum(shares, 1.0), 0.0))
        self._largest["traction"] = np.maximum(
            self._largest["traction"], np.where(alive, shares, 0.0).max(axis=0, initial=0.0)
        )
        slip = _largest(np.abs(rows["wheel_slip_speeds"][1:])) * self._dt
        self._slip += np.where(alive, slip, 0.0).sum(axis=0)
        least = np.where(alive, -_largest(-loads), np.inf).min(axis=0)
        self._least_load = np.minimum(self._least_load, least)

    def found(self) -> dict[str, Any]:
        """The numbers by name, shape (n,) each; for episodes that ended in a fall, up to the fall."""

        def mean(name: str, count: Array) -> Array:
            squares = np.divide(self._squares[name], count, out=np.full(len(count), np.nan), where=count > 0)
            return np.asarray(np.sqrt(squares))

        steps = self._seconds / self._dt
        never = self._unsettled >= self._time - 1e-9
        return {
            "fell": self.fell,
            "rms_tilt": mean("tilt", self._measured),
            "largest_tilt": self._largest["tilt"],
            "final_tilt": self._last["tilt"],
            "rms_error": mean("error", self._measured),
            "largest_error": self._largest["error"],
            "final_error": self._last["error"],
            "rms_velocity_error": mean("velocity", self._measured),
            "final_speed": self._last["speed"],
            "largest_yaw_error": self._largest["yaw"],
            "final_yaw_error": self._last["yaw"],
            "settling_time": np.where(self.fell | never, np.inf, self._unsettled),
            "recovery_time": np.where(self.fell | (self._leaning > self._time - HOLD + 1e-9), np.inf, self._leaning),
            "rms_torque": mean("torque", steps),
            "largest_torque": self._largest["torque"],
            "torque_variation": self._variation / np.maximum(self._seconds, self._dt),
            "energy": self._energy,
            "largest_traction": self._largest["traction"],
            "slip": self._slip,
            "least_load": np.where(np.isfinite(self._least_load), self._least_load, np.nan),
        }
