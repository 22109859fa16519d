"""Columns in a wrong order, unit or sign: what looks wrong, and what to write in the log's column map instead."""

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs.identification.logs.column_map import UNITS, ColumnMap

Array = npt.NDArray[np.float64]

#: Largest part of a column that belongs to other columns, relative to its own.
MAX_MIXING: Final = 0.5
#: Factors that a robot with other parameters may have, of all columns and of one relative to the others.
USUAL: Final = (0.25, 4.0)
#: Relative tolerance of a unit's factor.
TOLERANCE: Final = 1.6
NAMES: Final = {"gyro": "the gyroscope", "wheel_angles": "the encoders", "torques": "the torques"}


@dataclasses.dataclass(frozen=True)
class Order:
    """A matrix with one large number in each row and column."""

    #: Column of the large number of each row, shape (3,).
    places: npt.NDArray[np.int64]
    #: These numbers, shape (3,).
    factors: Array

    @classmethod
    def of(cls, matrix: Array) -> "Order | None":
        """The order of a matrix; None if its rows mix columns."""
        places = np.argmax(np.abs(matrix), axis=1)
        factors = matrix[np.arange(3), places]
        if len(set(places.tolist())) < 3:
            return None
        rest = np.sqrt(np.maximum((matrix**2).sum(axis=1) - factors**2, 0.0))
        return cls(places, factors) if (rest <= MAX_MIXING * np.abs(factors)).all() else None

    @property
    def common(self) -> float:
        """The size of the factors: their median, or one that is usual if the median is not."""
        sizes = np.abs(self.factors)
        middle = float(np.median(sizes))
        candidates: list[float] = [middle] if _is_usual(middle) else [middle, *filter(_is_usual, sizes.tolist())]
        return min(candidates, key=_far)

    @property
    def outliers(self) -> npt.NDArray[np.bool_]:
        """Which factors differ from the others as no parameters of a robot explain, shape (3,)."""
        return np.array([not _is_usual(one) for one in np.abs(self.factors) / self.common])

    @property
    def as_expected(self) -> bool:
        """Whether order, signs and sizes are as expected."""
        in_place = (self.places == np.arange(3)).all() and (self.factors > 0.0).all()
        return bool(in_place and _is_usual(self.common) and not self.outliers.any())


def _is_usual(factor: float) -> bool:
    return bool(USUAL[0] < factor < USUAL[1])


def _far(factor: float) -> float:
    """Distance of a factor from 1."""
    return float(abs(np.log(factor)))


def complaint(name: str, order: Order, columns: ColumnMap, fraction: float) -> str:
    """What is wrong with a quantity, the evidence, and the lines of the column map that repair it.

    Args:
        name: of the quantity.
        order: of its columns, relative to the expected changes.
        columns: the map that the log was read with.
        fraction: of the fast changes, explained by the torques.
    """
    titles = columns.columns[name]
    source = np.argsort(order.places)
    size, wrong, remedies = order.common, [], []
    evidence = f"the torques explain {100 * fraction:.0f} % of the fast changes of gyroscope and encoders"
    if name == "torques":
        evidence = f"gyroscope and encoders agree with each other, and {evidence}"
    factors = columns.factors[name][source]
    if (source != np.arange(3)).any():
        found = ", ".join(f"{titles[i]} is {titles[place]}" for i, place in enumerate(order.places) if i != place)
        wrong.append(f"the order of {NAMES[name]} looks wrong: {found}")
        remedies.append(f"[columns] {name} = [{', '.join(_quoted(titles[place]) for place in source)}]")
    if (order.factors < 0.0).any():
        found = ", ".join(title for title, one in zip(titles, order.factors, strict=True) if one < 0.0)
        wrong.append(f"the sign of {found} looks wrong")
        factors = factors * np.sign(order.factors)[source]
    if order.outliers.any():
        for title, one in zip(titles, order.factors, strict=True):
            if not _is_usual(abs(one) / size):
                wrong.append(f"{title} shows {abs(one) / size:.3g} times the changes that fit the other columns")
        relative = np.array([_rounded(one) for one in size / np.abs(order.factors)])
        factors = factors * np.where(order.outliers, relative, 1.0)[source]
    if (factors != columns.factors[name]).any():
        remedies.append(f"[scale] {name} = [{', '.join(f'{one:.6g}' for one in factors)}]")
    if not _is_usual(size):
        text, remedy = _unit(name, size, columns)
        shown = f"{', '.join(titles)} show {size:.3g} times the expected changes"
        wrong.append(f"{text}: {shown}")
        remedies += remedy
    if columns.ticks_per_turn is not None and name == "wheel_angles" and (source != np.arange(3)).any():
        ticks = columns.ticks_per_turn[source]
        if (ticks != columns.ticks_per_turn).any():
            remedies.append(f"ticks_per_turn = [{', '.join(f'{one:g}' for one in ticks)}]")
    what = f"in a column map, {', '.join(remedies)}" if remedies else f"give {_si(name)}, or the robot's own parameters"
    return f"{'; '.join(wrong)} ({evidence}); {what}"


def _unit(name: str, size: float, columns: ColumnMap) -> tuple[str, list[str]]:
    """What the unit of a quantity looks like, and the line that repairs it, if its factor is known."""
    now = columns.units[name]
    ticks = columns.ticks_per_turn if name == "wheel_angles" else None
    is_counted = ticks is not None
    # Of a number in the file.
    factor_now = UNITS[name][now] / (1.0 if ticks is None else float(ticks.mean()))
    for unit, factor in UNITS[name].items():
        if unit not in (now, "ticks") and 1.0 / TOLERANCE < factor_now / size / factor < TOLERANCE:
            without = " without ticks_per_turn" if is_counted else ""
            return f"{name} looks like {unit}, not {now}", [f'[units] {name} = "{unit}"{without}']
    text = f"the unit of {NAMES[name]} looks wrong"
    count = 2.0 * np.pi * size / factor_now
    if name == "wheel_angles" and count > 2.0 * np.pi:
        text += f", as encoders with about {count:.3g} ticks per turn, which their data sheet has"
        return text, [*([] if is_counted else ['[units] wheel_angles = "ticks"']), f"ticks_per_turn = {count:.3g}"]
    return text, []


def _si(name: str) -> str:
    return next(iter(UNITS[name]))


def _quoted(title: str) -> str:
    return '"' + title.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _rounded(factor: float) -> float:
    """A measured factor: the factor of degrees if it may be, else with two digits."""
    for known in (np.pi / 180.0, 180.0 / np.pi, 1e3, 1e-3):
        if 1.0 / TOLERANCE < factor / known < TOLERANCE:
            return float(known)
    return float(f"{factor:.2g}")
