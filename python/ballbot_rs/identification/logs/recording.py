"""Recordings: each quantity with its own time stamps, from columns that a map names."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.tables import Column

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
    #: Shape (n, k).
    values: Array
    #: Samples left out because a number or the time was missing.
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


def checked(source: str, clock: str, time: Array, values: Array) -> Series:
    """A series without the samples of which a number or the time is missing.

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
            f"{source}: time fails to increase {len(back)} times, first from row {rows[first]} to row "
            f"{rows[first + 1]}, by {times[first + 1] - times[first]:g} s: sort the rows, or cut the log where its "
            "clock was set"
        )
    return Series(source, clock, times, values[rows], missing)


def from_table(table: Mapping[str, Column], columns: ColumnMap) -> dict[str, Series]:
    """The series that a map names in a CSV or npz file.

    Raises:
        ValueError: a missing column, a quantity without a time column, columns of different lengths, or as `checked`.
    """

    def read(title: str) -> Column:
        if title not in table:
            raise InvalidInputError(
                f"column {title} is missing; there are {', '.join(table)}{did_you_mean(title, table)}"
            )
        return table[title]

    for name in columns.columns:
        if name not in columns.times:
            raise InvalidInputError(f"columns lacks time, and times has no {name}")
    raw = {columns.times[name]: read(columns.times[name]) for name in columns.columns}
    origin = min((one[np.isfinite(one)].min().item() for one in raw.values() if np.isfinite(one).any()), default=0)
    found = {}
    for name, titles in columns.columns.items():
        title = columns.times[name]
        values = [read(one) for one in titles]
        for one, column in zip(titles, values, strict=True):
            if len(column) != len(raw[title]):
                raise InvalidInputError(f"{one} has {len(column)} rows, {title} has {len(raw[title])}")
        time = since(origin, raw[title]) * columns.time_scale
        scaled = np.stack(values, axis=-1).astype(np.float64) * columns.scale(name)
        try:
            found[name] = checked(", ".join(titles), title, time, scaled)
        except InvalidInputError as error:
            raise InvalidInputError(f"{error}{single_precision(raw[title])}") from error
    return found


def since(origin: float, stamps: Column) -> Array:
    """Stamps minus an origin that is not after them.

    Counts of nanoseconds since 1970 lose digits as doubles unless the origin is subtracted first.
    """
    whole = math.floor(origin)
    if stamps.dtype.kind not in "iu" or not len(stamps):
        return np.asarray(stamps.astype(np.float64) - origin)
    # Without a wrap: as unsigned numbers if all are, in a type that has the origin.
    wide = stamps.astype(np.uint64 if stamps.dtype.kind == "u" and whole >= 0 else np.int64)
    if int(stamps.max()) - whole >= 2**63:
        return np.asarray(stamps.astype(np.float64) - origin)
    return np.asarray((wide - wide.dtype.type(whole)).astype(np.float64) - (origin - whole))


def single_precision(time: Column) -> str:
    """An explanation if times repeat because they were rounded to single precision, else an empty text."""
    times = np.asarray(time, dtype=np.float64)
    times = times[np.isfinite(times)]
    steps = np.diff(times)
    if not (steps == 0.0).any() or not (steps > 0.0).any():
        return ""
    first = int(np.argmax(steps == 0.0))
    near = times[max(first - 10, 0) : first + 10]
    resolution = float(np.spacing(np.float32(np.abs(near).max())))
    # As a double, or as the shortest decimal of a CSV file.
    is_single = all(float(np.float32(one)) == one or float(str(np.float32(one))) == one for one in near.tolist())
    if not is_single or 2.0 * resolution < float(np.median(steps[steps > 0.0])):
        return ""
    return (
        f"; the times look like single precision, which has steps of {resolution:.3g} at {near.max():.10g}: write them "
        "as double precision, or as integers"
    )
