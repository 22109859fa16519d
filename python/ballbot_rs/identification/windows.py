"""Windows of a log: short spans, each simulated from its own start, on one grid of model steps."""

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_real
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.log import SensorLog

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Length of a window, s.
WINDOW_LIMITS: Final = (0.05, 2.0)
#: Fewest rows in a window.
MIN_ROWS: Final = 8
#: Fewest windows in a log.
MIN_WINDOWS: Final = 4
#: Longest step in time within a window, in median steps.
MAX_GAP: Final = 4.0
#: Time steps to which a row's time is rounded.
ROUNDING: Final = 1e-6


@dataclasses.dataclass(frozen=True)
class Windows:
    """Windows and their rows; rows of a window are contiguous."""

    #: First model step of each window, counted from the first row of the log, shape (w,).
    starts: Indices
    #: Model steps of every window.
    steps: int
    #: Rows of the log, shape (m,).
    rows: Indices
    #: Window of each row, shape (m,).
    window: Indices
    #: Time of each row since the start of its window, in model steps, shape (m,).
    place: Array
    #: Where the rows of each window begin and end in `rows`, shape (w + 1,).
    bounds: Indices

    def __len__(self) -> int:
        return len(self.starts)

    def subset(self, chosen: npt.NDArray[np.bool_]) -> "Windows":
        """A subset of the windows."""
        rows = chosen[self.window]
        sizes = np.diff(self.bounds)[chosen]
        return Windows(
            self.starts[chosen],
            self.steps,
            self.rows[rows],
            np.repeat(np.arange(len(sizes)), sizes),
            self.place[rows],
            np.concatenate([[0], np.cumsum(sizes)]),
        )

    def rows_of(self, index: int) -> slice:
        """The range of a window's rows."""
        return slice(int(self.bounds[index]), int(self.bounds[index + 1]))


def split(log: SensorLog, window: float, sim_dt: float, settling: float) -> Windows:
    """Divides a log into windows, the first `settling` s after its beginning. No window contains a time gap.

    Raises:
        ValueError: a length that is out of range, or a log that is too short.
    """
    low, high = WINDOW_LIMITS
    window, sim_dt = check_real("window", window), check_real("sim_dt", sim_dt)
    if not low <= window <= high:
        raise InvalidInputError(f"window = {window} s is out of range: it must be from {low} to {high} s")
    if not 0.0 < sim_dt <= log.step * (1.0 + 1e-9):
        raise InvalidInputError(
            f"sim_dt = {sim_dt} s is out of range: it must be above 0 and at most the log's median step, {log.step:g} s"
        )
    steps = round(window / sim_dt)
    place = (log.time - log.time[0]) / sim_dt
    nearest = np.round(place)
    place = np.where(np.abs(place - nearest) < ROUNDING * np.maximum(nearest, 1.0), nearest, place)
    gap_before = np.concatenate([[False], np.diff(log.time) > MAX_GAP * log.step])
    starts, groups = [], []
    first = int(np.searchsorted(log.time - log.time[0], settling - 1e-12))
    while first < len(place):
        start = int(np.floor(place[first]))
        # A measurement belongs to one window; otherwise residuals of two windows would not be independent.
        last = int(np.searchsorted(place, start + steps))
        gaps = np.flatnonzero(gap_before[first + 1 : last])
        if len(gaps):
            first += 1 + int(gaps[0])
            continue
        if last - first >= MIN_ROWS and place[last - 1] >= start + steps - MAX_GAP * log.step / sim_dt:
            starts.append(start)
            groups.append(np.arange(first, last))
        first = last
    if len(starts) < MIN_WINDOWS:
        raise InvalidInputError(
            f"the log has {len(starts)} windows of {window:g} s without a gap, at least {MIN_WINDOWS} of {MIN_ROWS} "
            f"rows each are "
            f"needed: it has {len(place)} rows over {log.time[-1] - log.time[0]:g} s"
        )
    sizes = [len(group) for group in groups]
    rows = np.concatenate(groups)
    return Windows(
        starts=np.array(starts),
        steps=steps,
        rows=rows,
        window=np.repeat(np.arange(len(starts)), sizes),
        place=place[rows] - np.repeat(starts, sizes),
        bounds=np.concatenate([[0], np.cumsum(sizes)]),
    )
