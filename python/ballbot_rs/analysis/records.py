"""Records of the motions of many robots, thinned out while they are made."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _state_rows as rows_of
from ballbot_rs.analysis.closed_loop import CONTACTS

Array = npt.NDArray[Any]

#: Rows of states, by the name of an attribute of a state.
_STATES: Final[Mapping[str, slice]] = {
    "ball_position": rows_of.BALL_POSITION,
    "ball_quaternion": rows_of.BALL_QUATERNION,
    "ball_velocity": rows_of.BALL_VELOCITY,
    "ball_angular_velocity": rows_of.BALL_RATE,
    "body_position": rows_of.BODY_POSITION,
    "body_quaternion": rows_of.BODY_QUATERNION,
    "body_velocity": rows_of.BODY_VELOCITY,
    "body_angular_velocity": rows_of.BODY_RATE,
    "wheel_angles": rows_of.WHEEL_ANGLES,
    "wheel_speeds": rows_of.WHEEL_SPEEDS,
    "states": slice(0, 32),
}
#: Tilts from the equilibrium, for states and centers of mass.
_TILTS: Final[Mapping[str, Callable[[Array, Array], Array]]] = {
    "tilt": rows_of.tilt_of,
    "tilt_components": rows_of.tilt_components_of,
}
#: What may be recorded.
RECORDS: Final = (*_TILTS, *_STATES, "torques", *CONTACTS)


class KeptRows:
    """Thins out rows, and freezes robots whose episode has ended.

    Args:
        names: of `RECORDS`.
        kind: type of the records.
        count: number of rows that are kept.
        every: control steps from one to the next.
        com: center of mass of each robot, body frame, m, shape (n, 3).
    """

    def __init__(self, names: Sequence[str], kind: np.dtype[Any], count: int, every: int, com: Array) -> None:
        self._every, self._com, self._kind, self._count = every, com, kind, count
        self.values: dict[str, Array] = dict.fromkeys(names, np.empty(0))
        #: Steps at which episodes ended by a fall, and otherwise; NaN where they did not.
        self.fell, self.ended = (np.full(len(com), np.nan) for _ in range(2))
        self._frozen: dict[str, Array] = {}

    def add(self, rows: Mapping[str, Array], first: int, *, is_last: bool) -> None:
        """Adds control steps from the number `first` on; the row after them belongs to the last chunk alone."""
        ends = rows["terminated"] | rows["truncated"]
        length, n = ends.shape
        over = ~np.isnan(self.fell) | ~np.isnan(self.ended)
        # An episode's own rows: up to the one before the step that ends it.
        before = np.concatenate([np.zeros((1, n), dtype=bool), np.logical_or.accumulate(ends, axis=0)]) | over
        ending = np.where(ends.any(axis=0), ends.argmax(axis=0), length)
        now = ~over & (ending < length)
        fallen = now & rows["terminated"][np.minimum(ending, length - 1), np.arange(n)]
        self.fell[fallen] = first + ending[fallen] + 1
        self.ended[now & ~fallen] = first + ending[now & ~fallen] + 1
        numbers = np.arange(first, first + length + is_last)
        at = np.flatnonzero(numbers % self._every == 0)
        robots = np.flatnonzero(now)
        for name in self.values:
            values = self._record(name, rows, at)
            if name not in self._frozen:
                self._frozen[name] = np.empty(values.shape[1:])
                self.values[name] = np.empty((self._count, *values.shape[1:]), dtype=self._kind)
            self._frozen[name][robots] = self._record(name, rows, ending[robots], robots)
            mask = before[at].reshape(len(at), n, *(1,) * (values.ndim - 2))
            self.values[name][numbers[at] // self._every] = np.where(mask, self._frozen[name], values)

    def _record(self, name: str, rows: Mapping[str, Array], steps: Array, robots: Array | None = None) -> Array:
        """A record at steps of all robots, or at one step of each of some robots."""
        source = rows["states"] if name in _STATES or name in _TILTS else rows[name]
        # The last torques hold after the last step.
        steps = np.minimum(steps, len(source) - 1)
        found: Array = source[steps] if robots is None else source[steps, robots]
        if name in _TILTS:
            return _TILTS[name](found, self._com if robots is None else self._com[robots])
        return found[..., _STATES[name]] if name in _STATES else found
