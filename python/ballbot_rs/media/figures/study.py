"""Figures of a sweep: curves over one name, heat maps over two."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ballbot_rs._core import ACTUATOR_OPTIONS, ENVIRONMENT_OPTIONS, PARAMETERS, SENSOR_OPTIONS
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._short import number
from ballbot_rs.analysis.intervals import of_share
from ballbot_rs.analysis.study import Study
from ballbot_rs.envs.registration import description_of
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.figures.style import COLORS, INK, PAPER, below, figure
from ballbot_rs.scenarios.metrics import METRICS

_MAP: Final = LinearSegmentedColormap.from_list("study", ["#f1f3f5", "#66d9e8", COLORS[0], "#083344"])

#: Columns of shares, and units of others.
_SHARES: Final = ("survival_rate", "success_rate")
_UNITS: Final = {
    "tilt_rms": "rad",
    "ball_excursion": "m",
    "ball_rms": "m",
    "torque_rms": "N·m",
    "settling_time": "s",
    "recovery_time": "s",
    "control_dt": "s",
    "sim_dt": "s",
}
#: Values of an axis beyond this ratio are on a logarithmic scale.
_WIDE: Final = 30.0
#: Most cells of a heat map with their numbers in them, to an inch of width.
_CELLS: Final = 4.5
#: Least width of a panel, and height of a row of panels, inches.
_LEAST: Final = 2.0
_LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"


def draw(study: Study, value: str, width: float | None = None) -> Figure:
    """Curves with a color per controller, or a heat map for each.

    Raises:
        ValueError: a column without numbers, points that are not a grid of one or two names, or a width out of range.
    """
    numbers = np.array([_number(row.get(value), value) for row in study.rows]).reshape(len(study.points), -1)
    if not np.isfinite(numbers).any():
        raise InvalidInputError(f"the study has no number in the column '{value}'")
    if len(study.names) == 1:
        return _curves(study, value, numbers, width)
    if len(study.names) == 2:
        return _maps(study, value, numbers, width)
    raise InvalidInputError(
        f"a figure is of one or two names, and the sweep has {', '.join(study.names)}: to_dataframe() has all numbers"
    )


def _number(value: Any, name: str) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InvalidInputError(f"the column '{name}' is not of numbers: {value!r}")
    return float(value)


def _unit(name: str, task: str) -> str:
    parts = {"actuators": ACTUATOR_OPTIONS, "sensors": SENSOR_OPTIONS}
    head, _, part = name.rpartition(".")
    for table in (parts.get(head, PARAMETERS), ENVIRONMENT_OPTIONS, description_of(task)["metrics"]):
        for one in table:
            if one["name"] == part:
                return str(one["unit"] or "")
    return _UNITS.get(name, METRICS.get(name, ""))


def _label(name: str, task: str) -> str:
    # What an event draws is true, and unknown to controllers.
    true = "true " if name.startswith("events.") else ""
    name = name.removeprefix("events.").removeprefix("robot.")
    unit = _unit(name, task)
    text = true + name.replace("_", " ").replace(".", " ")
    return f"{text} ({unit})" if unit else text


def _title(case: dict[str, str]) -> str:
    return ", ".join([short(case["controller"]), *([case["scenario"]] if "scenario" in case else [])])


def _texts(values: Sequence[Any]) -> list[str]:
    """Labels of values: numbers and names as they are, robots of a file by their place."""
    return [f"{i + 1}" if isinstance(value, (dict, list)) else number(value) for i, value in enumerate(values)]


def _is_scale(values: Sequence[Any]) -> bool:
    return all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)


def _curves(study: Study, value: str, numbers: Any, width: float | None) -> Figure:
    (name,) = study.names
    values = [point[name] for point in study.points]
    scale = _is_scale(values)
    order = np.argsort(values) if scale else np.arange(len(values))
    places = np.array(values, dtype=float)[order] if scale else np.arange(len(values))
    fig = figure(5.0 if width is None else width, 3.0 if width is None else min(0.75 * width, 3.4))
    ax = fig.subplots()
    keys = []
    for i, case in enumerate(study.cases):
        color, marker = COLORS[i % len(COLORS)], "os^Dv<>"[i % 7]
        curve = numbers[order, i]
        bounds = _bounds(study, value, i, len(study.cases))
        if bounds is not None:
            ax.fill_between(places, *bounds[order].T, color=color, alpha=0.18, linewidth=0)
        # Curves one upon another are all seen: later ones have gaps and smaller markers.
        look: dict[str, Any] = {"color": color, "marker": marker, "markersize": max(6.5 - 1.2 * i, 2.5)}
        look["linestyle"] = ("-", "--", "-.", ":")[i % 4] if scale else ""
        ax.plot(places, curve, **look)
        keys.append(Line2D([], [], **look, label=_title(case)))
    if not scale:
        ax.set_xticks(places, _texts(values))
    elif places[0] > 0.0 and places[-1] / places[0] > _WIDE:
        ax.set_xscale("log")
        ax.set_xticks(places, _texts(places.tolist()))
        ax.minorticks_off()
    ax.set_xlabel(_label(name, study.task))
    ax.set_ylabel(_label(value, study.task))
    if value in _SHARES:
        ax.set_ylim(-0.03, 1.03)
    below(fig, keys, 6)
    return fig


def _bounds(study: Study, value: str, case: int, cases: int) -> Any:
    """Intervals at the points, shape (n, 2); None for columns without."""
    rows = study.rows[case::cases]
    if value in _SHARES and all("episodes" in row for row in rows):
        return np.array([of_share(row[value], row["episodes"]) for row in rows])
    low, high = f"{value}_low", f"{value}_high"
    if low not in rows[0]:
        return None
    return np.array([[_number(row[low], low), _number(row[high], high)] for row in rows])


def _maps(study: Study, value: str, numbers: Any, width: float | None) -> Figure:
    x, y = study.names
    points, cases = study.points, study.cases
    across, up = (_distinct([point[name] for point in points]) for name in (x, y))
    if len(across) * len(up) != len(points):
        raise InvalidInputError(
            f"{len(points)} points are not a grid of {len(across)} x {len(up)} values: to_dataframe() has all numbers"
        )
    cells = np.full((len(cases), len(up), len(across)), np.nan)
    for point, of_point in zip(points, numbers, strict=True):
        cells[:, up.index(point[y]), across.index(point[x])] = of_point
    count = len(cases)
    wide = min(3.0 * count, 9.0) + 1.0 if width is None else width
    columns = min(max(int((wide - 1.0) / _LEAST), 1), count)
    rows = -(-count // columns)
    each = (wide - 1.0) / columns
    fig = figure(wide, rows * min(0.85 * each, 0.3 * len(up) + 1.0) + 0.3)
    axes = fig.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    lowest, highest = (0.0, 1.0) if value in _SHARES else (np.nanmin(cells), np.nanmax(cells))
    norm = Normalize(lowest, highest if highest > lowest else lowest + 1.0)
    for ax in axes.ravel()[count:]:
        ax.remove()
    for i, (ax, case) in enumerate(zip(axes.ravel(), cases, strict=False)):
        ax.grid(visible=False)
        # Where there is no number, as for a time to recover of robots that fall.
        ax.set_facecolor("#ced4da")
        shown = ax.pcolormesh(cells[i], cmap=_MAP, norm=norm, edgecolors=PAPER, linewidth=0.6)
        _write_numbers(ax, cells[i], norm, each)
        letter = f"({_LETTERS[i]}) " if 1 < count <= len(_LETTERS) else ""
        ax.set_title(letter + _title(case), loc="left")
        ax.set_xticks(np.arange(len(across)) + 0.5, _texts(across), rotation=45 if len(across) > 6 else 0)
        ax.set_yticks(np.arange(len(up)) + 0.5, _texts(up))
        ax.tick_params(length=0)
        if i + columns >= count:
            ax.set_xlabel(_label(x, study.task))
            ax.tick_params(labelbottom=True)
        if i % columns == 0:
            ax.set_ylabel(_label(y, study.task))
    bar = fig.colorbar(shown, ax=list(axes.ravel()[:count]), shrink=0.9, pad=0.02, aspect=30)
    bar.set_label(_label(value, study.task))
    bar.outline.set_visible(False)
    return fig


def _distinct(values: Sequence[Any]) -> list[Any]:
    """Values in ascending order, or, for names, in their order."""
    found: list[Any] = []
    for value in values:
        if value not in found:
            found.append(value)
    return sorted(found) if _is_scale(found) else found


def _write_numbers(ax: Any, cells: Any, norm: Normalize, inches: float) -> None:
    """The number of each cell, where they have room."""
    if cells.shape[1] > _CELLS * inches / 1.6:
        return
    for (row, column), value in np.ndenumerate(cells):
        if np.isfinite(value):
            color = PAPER if norm(value) > 0.55 else INK
            ax.text(column + 0.5, row + 0.5, f"{value:.2g}", ha="center", va="center", fontsize=7, color=color)
