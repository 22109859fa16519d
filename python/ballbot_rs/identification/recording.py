"""Recordings: each quantity with its own time stamps, from columns that a map names."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.column_map import ColumnMap

Array = npt.NDArray[np.float64]

#: Longest time between two samples of a quantity that is not a gap, in its median steps.
MAX_GAP: Final = 4.0
#: Fewest samples of a quantity.
MIN_SAMPLES: Final = 16


@dataclasses.dataclass(frozen=True)
class Series:
    """Samples of one quantity."""

    #: What it was read from: columns, or a topic and its fields.
    source: str
    #: Name of its clock: series of one clock have no offset.
    clock: str
    #: s, increasing, shape (n,).
    time: Array
    #: Shape (n, 3).
    values: Array
    #: Samples left out because a number was missing.
    missing: int = 0

    @property
    def step(self) -> float:
        """Median time between two samples, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> Array:
        """Durations of the gaps, s."""
        steps = np.diff(self.time)
        return np.asarray(steps[steps > MAX_GAP * self.step])

    def shifted(self, offset: float) -> "Series":
        """The series with `offset` added to its times."""
        return dataclasses.replace(self, time=self.time + offset)


def checked(source: str, clock: str, time: Array, values: Array) -> Series:
    """A series without the samples of which a number is missing.

    Raises:
        ValueError: too few samples, or a time that does not increase.
    """
    kept = np.isfinite(values).all(axis=1) & np.isfinite(time)
    # Rows in which all columns are empty belong to quantities with other rates.
    absent = np.isnan(values).all(axis=1)
    missing = int((~kept & ~absent).sum())
    rows = np.flatnonzero(kept)
    if len(rows) < MIN_SAMPLES:
        raise InvalidInputError(f"{source} has {len(rows)} complete samples, at least {MIN_SAMPLES} are needed")
    times = time[rows]
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        first = int(back[0])
        raise InvalidInputError(
            f"{source}: time does not increase {len(back)} times, first from row {rows[first]} to row "
            f"{rows[first + 1]}, by {times[first + 1] - times[first]:g} s: sort the rows, or cut the log where its "
            "clock was set"
        )
    return Series(source, clock, times, values[rows], missing)


def from_columns(
    read: Callable[[str], Array], columns: ColumnMap, time_of: Callable[[str], tuple[str, str]]
) -> dict[str, Series]:
    """The series that a map names.

    Args:
        read: the column of a name, as numbers.
        columns: the map.
        time_of: the name of the time column of a quantity, and of its clock.

    Raises:
        ValueError: a missing column, columns of different lengths, or as `checked`.
    """
    times = {name: time_of(name) for name in columns.columns}
    raw = {title: read(title) for title, _ in times.values()}
    # Counts of nanoseconds since 1970 lose digits unless the origin is subtracted first.
    origin = min((float(one[np.isfinite(one)].min()) for one in raw.values() if np.isfinite(one).any()), default=0.0)
    found = {}
    for name, titles in columns.columns.items():
        title, clock = times[name]
        values = [read(one) for one in titles]
        for one, column in zip(titles, values, strict=True):
            if len(column) != len(raw[title]):
                raise InvalidInputError(f"{one} has {len(column)} rows, {title} has {len(raw[title])}")
        time = (raw[title] - origin) * columns.time_scale
        found[name] = checked(", ".join(titles), clock, time, np.stack(values, axis=-1) * columns.scale[name])
    return found


def from_table(table: Mapping[str, Array], columns: ColumnMap) -> dict[str, Series]:
    """The series of a CSV or npz file.

    Raises:
        ValueError: as `from_columns`, or a quantity without a time column.
    """

    def read(title: str) -> Array:
        if title not in table:
            raise InvalidInputError(
                f"column {title} is missing; there are {', '.join(table)}{did_you_mean(title, table)}"
            )
        return np.asarray(table[title], dtype=np.float64)

    def time_of(name: str) -> tuple[str, str]:
        if name not in columns.times:
            raise InvalidInputError(f"columns lacks time, and times has no {name}")
        return columns.times[name], columns.times[name]

    return from_columns(read, columns, time_of)
