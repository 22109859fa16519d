"""A column map: which columns of a file are which quantity, in which unit and with which sign, from TOML."""

import dataclasses
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _toml
from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._reading import read_regular

Array = npt.NDArray[np.float64]

#: Largest file of a map, bytes.
MAX_MAP_FILE: Final = 1 << 20
#: Factors to SI units; the first unit of each quantity is the default.
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "torques": {"Nm": 1.0, "mNm": 1e-3},
    "wheel_angles": {"rad": 1.0, "deg": np.pi / 180.0, "turn": 2.0 * np.pi, "ticks": 2.0 * np.pi},
    "gyro": {"rad/s": 1.0, "deg/s": np.pi / 180.0},
    "accelerations": {"m/s^2": 1.0, "g": 9.80665},
    "attitude": {"quaternion": 1.0},
    "position": {"m": 1.0, "mm": 1e-3},
}
#: Columns of each quantity, and the quantities that a log may lack.
SIZES: Final[Mapping[str, int]] = {
    "torques": 3,
    "wheel_angles": 3,
    "gyro": 3,
    "accelerations": 3,
    "attitude": 4,
    "position": 3,
}
OPTIONAL: Final = ("accelerations", "attitude", "position")
#: Largest offset between clocks, s.
MAX_OFFSET: Final = 10.0

_TABLES: Final = ("columns", "times", "units", "scale", "ticks_per_turn", "clock_offset")


@dataclasses.dataclass(frozen=True)
class ColumnMap:
    """Columns of a file; values times `scale` are in SI units and have the signs of docs/conventions.md."""

    #: Names by quantity.
    columns: Mapping[str, tuple[str, ...]]
    #: Time column of each quantity; a quantity of an MCAP file that is not here has the times of its messages.
    times: Mapping[str, str]
    #: Unit of each quantity and of `time`.
    units: Mapping[str, str]
    #: Of each quantity, in addition to its unit, a number for each column.
    factors: Mapping[str, Array]
    #: Of encoders with the unit `ticks`, shape (3,).
    ticks_per_turn: Array | None
    #: Time of the IMU's clock minus time of the encoders' clock, s; None: estimated.
    clock_offset: float | None

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "ColumnMap":
        """The map in a TOML file; docs/identify.md has its keys.

        Raises:
            ValueError: malformed TOML, an unknown key, unit or quantity, or a value out of range.
            OSError: the file cannot be read.
        """
        path = Path(path)
        contents = read_regular(path, MAX_MAP_FILE)
        try:
            return cls.of(_toml.loads(contents.decode()))
        except (ValueError, TypeError) as error:
            raise InvalidInputError(f"{path}: {error}") from error

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> "ColumnMap":
        """The map in a table. Raises ValueError as `load`."""
        _check_keys("key", table, _TABLES)
        columns = dict(_table(table, "columns", ("time", *SIZES)))
        time = columns.pop("time", None)
        if time is not None and not isinstance(time, str):
            raise InvalidInputError(f"columns.time = {time!r}, expected the name of a column")
        for name, titles in columns.items():
            count = SIZES[name]
            if not (
                isinstance(titles, (list, tuple))
                and len(titles) == count
                and all(isinstance(one, str) for one in titles)
            ):
                words = "three" if count == 3 else "four"
                raise InvalidInputError(f"columns.{name} = {titles!r}, expected {words} names of columns")
        titles = [*(one for several in columns.values() for one in several), *filter(None, [time])]
        if twice := [title for title in titles if titles.count(title) > 1]:
            raise InvalidInputError(f"columns names {twice[0]!r} twice")
        if missing := [name for name in SIZES if name not in columns and name not in OPTIONAL]:
            raise InvalidInputError(f"columns lacks {', '.join(missing)}")
        times = _table(table, "times", tuple(SIZES))
        for name, title in times.items():
            if not isinstance(title, str):
                raise InvalidInputError(f"times.{name} = {title!r}, expected the name of a column")
        units = _table(table, "units", ("time", *SIZES))
        for name, unit in units.items():
            if not isinstance(unit, str) or unit not in UNITS[name]:
                raise InvalidInputError(f"units.{name} = {unit!r}, expected one of {', '.join(UNITS[name])}")
        units = {name: units.get(name, next(iter(known))) for name, known in UNITS.items()}
        scale = _table(table, "scale", tuple(SIZES))
        shared = {} if time is None else dict.fromkeys(columns, time)
        return cls(
            {name: tuple(titles) for name, titles in columns.items()},
            {**shared, **times},
            units,
            {name: _numbers(f"scale.{name}", scale.get(name, 1.0), SIZES[name]) for name in columns},
            _ticks(table.get("ticks_per_turn"), units["wheel_angles"]),
            _offset(table.get("clock_offset")),
        )

    def scale(self, name: str) -> Array:
        """Factors to SI units, a number for each column."""
        found = UNITS[name][self.units[name]] * self.factors[name]
        is_counted = name == "wheel_angles" and self.ticks_per_turn is not None
        return np.asarray(found / self.ticks_per_turn if is_counted else found)  # type: ignore[operator]

    @property
    def time_scale(self) -> float:
        """Factor of all time columns to s."""
        return UNITS["time"][self.units["time"]]

    @property
    def names(self) -> set[str]:
        """All columns that are read."""
        return {title for titles in self.columns.values() for title in titles} | set(self.times.values())


def _check_keys(what: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for name in table:
        if name not in known:
            raise InvalidInputError(
                f"unknown {what} {name!r}: expected one of {', '.join(known)}{did_you_mean(str(name), known)}"
            )


def _table(table: Mapping[str, Any], key: str, known: tuple[str, ...]) -> Mapping[str, Any]:
    found = table.get(key, {})
    if not isinstance(found, Mapping):
        raise InvalidInputError(f"{key} = {found!r}, expected a table")
    _check_keys(f"quantity in {key}", found, known)
    return found


def _numbers(key: str, value: Any, count: int = 3) -> Array:
    """One number, or one for each column, neither zero nor infinite, as shape (count,)."""
    values = list(value) if isinstance(value, (list, tuple)) else [value]
    numeric = all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in values)
    if not numeric or len(values) not in (1, count) or not all(np.isfinite(one) and one != 0 for one in values):
        words = "three" if count == 3 else "four"
        raise InvalidInputError(f"{key} = {value!r}, expected a finite number other than 0, or {words}")
    return np.asarray(values, dtype=np.float64) * np.ones(count)


def _ticks(value: Any, unit: str) -> Array | None:
    if unit == "ticks" and value is None:
        raise InvalidInputError("units.wheel_angles = 'ticks' needs ticks_per_turn, of the wheel behind the gear")
    if unit != "ticks" and value is not None:
        raise InvalidInputError(f"ticks_per_turn needs units.wheel_angles = 'ticks', which is {unit!r}")
    return None if value is None else _numbers("ticks_per_turn", value)


def _offset(value: Any) -> float | None:
    if value is None or value == "estimate":
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_OFFSET:
        raise InvalidInputError(
            f"clock_offset = {value!r}, expected 'estimate' or a number of seconds within ±{MAX_OFFSET:g}"
        )
    return float(value)
