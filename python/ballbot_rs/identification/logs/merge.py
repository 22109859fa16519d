"""Quantities with different time stamps brought to common rows, and a report of what was done."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs import clocks
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.recording import MAX_GAP, Series

Array = npt.NDArray[np.float64]

#: Quantities of the IMU; others have the clock of the encoders, unless they have the stamps of the gyroscope.
IMU: Final = ("gyro", "accelerations")
#: Quantities whose rates determine the rows.
SENSORS: Final = ("wheel_angles", *IMU)


@dataclasses.dataclass(frozen=True)
class Source:
    """What a quantity of a log was read from."""

    quantity: str
    #: Columns, or topic and fields.
    name: str
    samples: int
    #: Hz, from the median step.
    rate: float
    #: Samples left out because a number or the time was missing.
    missing: int
    #: Number of gaps of more than four median steps, and the longest, s; 0.0 without gaps.
    gaps: int
    longest_gap: float

    @classmethod
    def of(cls, quantity: str, series: Series) -> "Source":
        """The source of a series."""
        gaps = series.gaps
        longest = float(gaps.max(initial=0.0))
        return cls(quantity, series.source, len(series.time), 1.0 / series.step, series.missing, len(gaps), longest)


@dataclasses.dataclass(frozen=True)
class LogReport:
    """How a log was read."""

    sources: tuple[Source, ...]
    columns: ColumnMap
    #: Rows of the log, and rows left out in gaps of other quantities.
    rows: int
    left_out: int
    #: Time of the IMU's clock minus time of the encoders' clock, s; None: one clock, or not determined.
    clock_offset: float | None = None
    #: Standard error of an estimated offset, s; None for a given offset.
    clock_offset_error: float | None = None
    #: Growth of the offset, s/s, and its standard error; None: not estimated.
    clock_drift: float | None = None
    clock_drift_error: float | None = None
    #: Whether the times of the IMU were corrected by the offset, and by the drift.
    corrected: bool = False
    drift_corrected: bool = False
    #: Whether IMU and encoders have separate clocks.
    separate_clocks: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and dicts."""
        plain = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "columns"}
        return {**plain, "sources": [dataclasses.asdict(one) for one in self.sources]}

    def lines(self) -> list[str]:
        """The report as text, a line per source and for the clocks."""
        found = []
        for one in self.sources:
            gaps = f"{one.gaps} gaps, longest {one.longest_gap:.3g} s" if one.gaps else "no gaps"
            missing = f", {one.missing} incomplete samples left out" if one.missing else ""
            found.append(f"{one.quantity}: {one.name}: {one.samples} samples at {one.rate:.4g} Hz, {gaps}{missing}")
        found.append(f"{self.rows} rows, {self.left_out} left out in gaps")
        if self.separate_clocks:
            found.append(self._clocks())
        return found

    def _clocks(self) -> str:
        if self.clock_offset is None:
            return "clock offset of the IMU: not determined by the motion; give clock_offset if it is not zero"
        error = "given" if self.clock_offset_error is None else f"± {1e3 * self.clock_offset_error:.2g} ms"
        done = "corrected" if self.corrected else "not significant, not corrected"
        ahead = "later" if self.clock_offset >= 0.0 else "earlier"
        return (
            f"clock offset: stamps of the IMU are {1e3 * abs(self.clock_offset):.3g} ms {ahead} than stamps of the "
            f"encoders ({error}), {done}{self._drift()}"
        )

    def _drift(self) -> str:
        if self.clock_drift is None or self.clock_drift_error is None:
            return ""
        done = "corrected" if self.drift_corrected else "not significant, not corrected"
        return f"; drift {1e6 * self.clock_drift:.3g} ± {1e6 * self.clock_drift_error:.2g} ppm, {done}"


def merged(series: Mapping[str, Series], columns: ColumnMap) -> tuple[dict[str, Array], LogReport]:
    """Fields of a log, and the report.

    Rows have the times of the slowest of encoders, gyroscope and accelerometer, within the time that all quantities
    have. Encoders and gyroscope are interpolated linearly, accelerations are averaged since the previous row, torques
    to the next. Rows in a gap of any quantity are left out.

    Args:
        series: by quantity.
        columns: its `clock_offset` is removed; None estimates it if IMU and encoders have separate clocks.

    Raises:
        ValueError: quantities without a common time.
        ModuleNotFoundError: an offset is estimated, and SciPy is missing (extra `identify`).
    """
    sources = tuple(Source.of(name, one) for name, one in series.items())
    series, about = _synchronized(series, columns.clock_offset)
    measured = {name: one for name, one in series.items() if name in SENSORS}
    grid = max(measured, key=lambda name: measured[name].step)
    time = measured[grid].time
    torques = series["torques"]
    first = max(one.time[0] for one in series.values())
    # The last command holds for a step.
    last = min(*(one.time[-1] for name, one in series.items() if name != "torques"), torques.time[-1] + torques.step)
    common = time[(time >= first) & (time <= last)]
    if len(common) < 2:
        spans = ", ".join(f"{name} {one.time[0]:.3f} to {one.time[-1]:.3f} s" for name, one in series.items())
        raise InvalidInputError(f"the quantities have no common time: {spans}")
    kept = np.ones(len(common), dtype=np.bool_)
    for one in series.values():
        kept &= ~_in_gap(one.time, common, MAX_GAP * one.step)
    rows = common[kept]
    if len(rows) < 2:
        raise InvalidInputError(f"all {len(common)} rows are in gaps of a quantity")
    fields = {"time": rows, "torques": _held(torques, rows)}
    for name in ("wheel_angles", "gyro", "attitude", "position"):
        if name in series:
            one = series[name]
            values = _continuous(one.values) if name == "attitude" else one.values
            fields[name] = np.stack([np.interp(rows, one.time, column) for column in values.T], axis=-1)
    if "accelerations" in series:
        fields["accelerations"] = _means(series["accelerations"], rows)
    return fields, LogReport(sources, columns, len(rows), len(common) - len(rows), **about)


def _synchronized(
    series: Mapping[str, Series], clock_offset: float | None
) -> tuple[Mapping[str, Series], dict[str, Any]]:
    """The series with the times of the encoders' clock, and the fields of the report about clocks."""
    separate = series["gyro"].clock != series["wheel_angles"].clock
    found = None
    if clock_offset is None and separate:
        found = clocks.estimated(series["gyro"], series["wheel_angles"])
    about: dict[str, Any] = {"clock_offset": clock_offset, "corrected": clock_offset is not None}
    drift, time = 0.0, 0.0
    if found is not None:
        is_drifting = abs(found.drift) > clocks.SIGNIFICANT * found.drift_error
        corrected = is_drifting or abs(found.value) > clocks.SIGNIFICANT * found.error
        about = {"clock_offset": found.value, "clock_offset_error": found.error, "corrected": corrected}
        if np.isfinite(found.drift_error):
            about |= {"clock_drift": found.drift, "clock_drift_error": found.drift_error}
            about["drift_corrected"] = is_drifting
        drift, time = (found.drift, found.time) if is_drifting else (0.0, 0.0)
    if about["corrected"]:
        own = series["gyro"].clock

        def on_encoders(one: Series) -> Series:
            return dataclasses.replace(one, time=one.time - about["clock_offset"] - drift * (one.time - time))

        series = {
            name: on_encoders(one) if name in IMU or (separate and one.clock == own) else one
            for name, one in series.items()
        }
    return series, {**about, "separate_clocks": separate or about["corrected"]}


def _continuous(attitude: Array) -> Array:
    """Unit quaternions of which neighbors have one sign, for an interpolation: q and -q are one attitude."""
    unit = attitude / np.linalg.norm(attitude, axis=1, keepdims=True).clip(min=1e-300)
    flips = np.sign((unit[1:] * unit[:-1]).sum(axis=1))
    return np.asarray(unit * np.cumprod(np.insert(np.where(flips == 0.0, 1.0, flips), 0, 1.0))[:, None])


def _in_gap(time: Array, places: Array, limit: float) -> npt.NDArray[np.bool_]:
    """Whether places are strictly between two samples that are more than `limit` apart."""
    after = np.searchsorted(time, places)
    inside = (after > 0) & (after < len(time))
    after = np.clip(after, 1, len(time) - 1)
    return np.asarray(inside & (time[after] != places) & (time[after] - time[after - 1] > limit))


def _integral(time: Array, rates: Array, places: Array) -> Array:
    """Integral of rates, each constant from `time[k]` to `time[k + 1]`, up to places."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(rates * np.diff(time)[:, None], axis=0)])
    return np.stack([np.interp(places, time, one) for one in sums.T], axis=-1)


def _held(torques: Series, rows: Array) -> Array:
    """Mean of the held commands from each row to the next."""
    if np.array_equal(torques.time, rows):
        return torques.values
    ends = np.append(rows, rows[-1] + np.median(np.diff(rows)))
    time = np.append(torques.time, max(torques.time[-1], ends[-1]) + torques.step)
    return np.asarray(np.diff(_integral(time, torques.values, ends), axis=0) / np.diff(ends)[:, None])


def _means(series: Series, rows: Array) -> Array:
    """Mean since the previous row, of samples that are means since the previous sample."""
    if np.array_equal(series.time, rows):
        return series.values
    begins = np.insert(rows, 0, rows[0] - np.median(np.diff(rows)))
    time = np.insert(series.time, 0, min(series.time[0], begins[0]) - series.step)
    return np.asarray(np.diff(_integral(time, series.values, begins), axis=0) / np.diff(begins)[:, None])
