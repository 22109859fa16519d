"""The matrix of scenarios and controllers."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.scenario import Scenario

#: Columns of a printed line.
WIDTH: Final = 100

#: Display of a score: factor, unit and digits.
_UNITS: Final = {
    "largest_error": (1e3, "mm", 4),
    "rms_error": (1e3, "mm", 3),
    "final_error": (1e3, "mm", 3),
    "rms_velocity_error": (1e2, "cm/s", 3),
    "settling_time": (1.0, "s", 3),
    "recovery_time": (1.0, "s", 3),
    "rms_tilt": (math.degrees(1.0), "deg", 3),
    "largest_tilt": (math.degrees(1.0), "deg", 3),
    "largest_yaw_error": (math.degrees(1.0), "deg", 3),
    "final_yaw_error": (math.degrees(1.0), "deg", 3),
    "success": (100.0, "%", 3),
}

LEGEND: Final = """\
Maps: the largest tilt or push up to which all recover, worst direction.
Others: the worst direction, or of random episodes the mean of the worse half (CVaR 0.5).
"falls" is k of n episodes; "-" marks scenarios that do not apply to a controller."""


def factor_and_unit(scenario: Scenario) -> tuple[float, str]:
    """Factor and unit in which the score of a scenario is shown."""
    if scenario.is_map:
        return 1.0, "deg" if isinstance(scenario.tilt, tuple) else "N·s"
    return _UNITS.get(scenario.score, (1.0, "", 3))[:2]


def unit(scenario: Scenario) -> str:
    """Display unit of the score of a scenario."""
    return factor_and_unit(scenario)[1]


def cell(outcome: Outcome | None) -> str:
    """A score as text."""
    if outcome is None or outcome.skipped is not None:
        return "-"
    if outcome.scenario.is_map:
        return f"{outcome.score:.4g}"
    falls = int(outcome.metrics["fell"].sum())
    if falls and not outcome.higher_is_better:
        return f"falls {falls}/{len(outcome.success)}" if len(outcome.success) > 1 else "falls"
    factor, _, digits = _UNITS.get(outcome.scenario.score, (1.0, "", 3))
    if not math.isfinite(outcome.score):
        return "never"
    value = factor * outcome.score
    return "0" if abs(value) < 1e-6 else f"{value:.{digits}g}"


def rows(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """A header, and a row for each scenario with a column for each controller."""
    found: Mapping[tuple[str, str], Outcome] = {(one.scenario.id, one.controller): one for one in outcomes}
    scenarios = {one.scenario.id: one.scenario for one in outcomes}
    controllers = list(dict.fromkeys(one.controller for one in outcomes))
    body = [
        [name, scenario.title, unit(scenario), *(cell(found.get((name, controller))) for controller in controllers)]
        for name, scenario in scenarios.items()
    ]
    return [["", "scenario", "unit", *controllers], *body]


def text(outcomes: Sequence[Outcome]) -> str:
    """The matrix within 100 columns, in several blocks if there are many controllers."""
    header, *body = rows(outcomes)
    wide = [max(len(row[i]) for row in (header, *body)) for i in range(len(header))]
    first = [0, 2]
    blocks: list[list[int]] = [[]]
    used = sum(wide[i] + 2 for i in first)
    for i in range(3, len(header)):
        if blocks[-1] and used + sum(wide[j] + 2 for j in (*blocks[-1], i)) > WIDTH:
            blocks.append([])
        blocks[-1].append(i)
    lines: list[str] = []
    for block in blocks:
        columns = [*first, *block]
        for row in (header, ["-" * width for width in wide], *body):
            cells = [row[i].ljust(wide[i]) if i < 3 else row[i].rjust(wide[i]) for i in columns]
            lines.append("  ".join(cells).rstrip())
        lines.append("")
    lines += [f"{row[0]}: {row[1]}." for row in body]
    notes = [textwrap.fill(line, WIDTH) for line in LEGEND.splitlines()]
    return "\n".join([*lines, "", *notes])
