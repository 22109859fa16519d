"""The results of a sweep, as a table and as a figure."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _files, _short
from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require

#: Rows of a table in a notebook.
MOST_SHOWN: Final = 50

#: Columns that name what was run, apart from the names of the sweep.
_CASES: Final = ("scenario", "controller")


@dataclasses.dataclass(frozen=True, repr=False)
class Study:
    """Controllers at the points of a sweep, as `compare` and `run_scenarios` return them with `sweep=`.

    ```python
    study = bb.compare(["lqr", "lqi"], episodes=5, sweep={"body_mass": [2.0, 2.5]})
    print(study.column("survival_rate", controller="lqr"))
    ```

    Shown as a table of `value` in a notebook.
    """

    #: Names of the sweep.
    names: tuple[str, ...]
    #: One row for each point and controller (and scenario), by column: the values of the point, then the numbers of
    #: `Result.row` or `Outcome.row`. Missing numbers are None.
    rows: Sequence[Mapping[str, Any]]
    #: Column of the numbers that are shown unless another is named.
    value: str = "survival_rate"
    #: Name of the task.
    task: str = "balance"
    #: Factor and unit in which the table shows the scores of a scenario, by its id.
    units: Mapping[str, tuple[float, str]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.rows:
            raise InvalidInputError("a sweep compares controllers, and none is given")

    @property
    def points(self) -> list[dict[str, Any]]:
        """Points of the sweep, in their order."""
        found: list[dict[str, Any]] = []
        for row in self.rows:
            point = {name: row[name] for name in self.names}
            if not found or point != found[-1]:
                found.append(point)
        return found

    @property
    def cases(self) -> list[dict[str, str]]:
        """What was run at each point: controllers, in scenarios if there are several."""
        first = self.rows[: len(self.rows) // len(self.points)]
        return [{name: row[name] for name in _CASES if name in row} for row in first]

    def column(self, name: str, **case: str) -> list[Any]:
        """The numbers of a column, at the points in their order; of one controller, `controller="lqr"`, or of all.

        Raises:
            ValueError: an unknown column, or an unknown controller or scenario.
        """
        self._check(name)
        found = [row[name] for row in self.rows if all(row.get(key) == value for key, value in case.items())]
        if not found:
            raise InvalidInputError(f"the study has no {' in '.join(case.values())}")
        return found

    def _check(self, name: str) -> None:
        known = list(self.rows[0])
        if name not in known:
            close = did_you_mean(name, known) or f": expected one of {', '.join(known)}"
            raise InvalidInputError(f"the study has no column '{name}'{close}")

    def table(self, value: str | None = None) -> list[list[str]]:
        """A header, and for each point its values and a number of each controller, as text.

        Args:
            value: the column of the numbers; None is `value` of the study.

        Raises:
            ValueError: an unknown column.
        """
        value = value or self.value
        self._check(value)
        cases, points = self.cases, self.points
        units = [
            self.units.get(case.get("scenario", ""), (1.0, "")) if value == "score" else (1.0, "") for case in cases
        ]
        body = [[_short.number(point[name]) for name in self.names] for point in points]
        for i, row in enumerate(self.rows):
            factor, _ = units[i % len(cases)]
            body[i // len(cases)].append("none" if row[value] is None else _short.number(factor * row[value]))
        titles = [
            " ".join(case.values()) + (f" ({unit})" if unit else "")
            for case, (_, unit) in zip(cases, units, strict=True)
        ]
        return [[*self.names, *titles], *body]

    def __repr__(self) -> str:
        controllers = dict.fromkeys(case["controller"] for case in self.cases)
        return f"<Study of {', '.join(controllers)}: {len(self.points)} points of {', '.join(self.names)}>"

    def _repr_html_(self) -> str:
        header, *body = self.table()
        more = "" if len(body) <= MOST_SHOWN else f"<p>{len(body) - MOST_SHOWN} more points</p>"
        return f"<b>{self.value.replace('_', ' ')}</b>{_short.table(body[:MOST_SHOWN], header)}{more}"

    def to_dataframe(self) -> Any:
        """A `pandas.DataFrame` of the rows.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        with require("a DataFrame", "pandas"):
            import pandas as pd
        return pd.DataFrame(list(self.rows))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Writes the rows as CSV; numbers read back bit for bit, missing numbers are empty.

        Raises:
            ValueError: a suffix other than .csv.
            OSError: the file cannot be written; an earlier one stays as it is.
        """
        import csv
        import io

        file = Path(path)
        if file.suffix != ".csv":
            raise InvalidInputError(f"{file}: the name of the file must end in .csv")
        text = io.StringIO()
        writer = csv.DictWriter(text, list(self.rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        _files.write(file, text.getvalue())

    def plot(
        self, value: str | None = None, path: str | PathLike[str] | None = None, *, width: float | None = None
    ) -> Any:
        """The matplotlib figure of a column over the sweep: curves of one name, heat maps of two.

        Bands are 95 % intervals: Wilson intervals for fractions, bootstrap intervals for means of metrics.

        Args:
            value: the column; None is `value` of the study.
            path: the file to write, if any.
            width: of the figure, inches, for example 3.5 for one column of a paper.

        Raises:
            ModuleNotFoundError: matplotlib is not installed.
            ValueError: an unknown column or a column without numbers, points that are not a grid of one or two names,
                a suffix other than .svg, .pdf or .png, or a width out of range.
            OSError: as `to_csv`.
        """
        with require("a figure", "plot"):
            from ballbot_rs.media.figures import study, style
        self._check(value or self.value)
        file = None if path is None else Path(path)
        if file is not None:
            style.check_suffix(file)
        drawn = study.draw(self, value or self.value, width)
        if file is not None:
            style.save(drawn, file)
        return drawn
