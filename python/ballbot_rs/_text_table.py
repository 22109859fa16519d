"""Results of controllers as rows of text."""

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ballbot_rs.analysis.conditions import differences, success_rule
from ballbot_rs.analysis.result import Result
from ballbot_rs.envs.registration import description_of

#: Columns of a printed line.
WIDTH = 100
#: Least width of the names in a table.
LEAST_NAME = 16

_COLUMNS: dict[str, Callable[[Result], str]] = {
    "controller": lambda r: r.controller,
    "rate (Hz)": lambda r: f"{1 / r.control_dt:.0f}",
    "success": lambda r: f"{100 * r.success_rate:.0f} %",
    "upright": lambda r: f"{100 * r.survival_rate:.0f} %",
    "settling (s)": lambda r: "never" if r.settling_time is None else f"{r.settling_time:.2f}",
    "tilt (deg)": lambda r: f"{math.degrees(r.tilt_rms):.2f}",
    "ball (m)": lambda r: f"{r.ball_excursion:.3f}",
    "torque (N·m)": lambda r: f"{r.torque_rms:.3f}",
    "reward": lambda r: f"{r.mean_reward:.3f}",
}


LEGEND = (
    "Upright: to the end of the episode.",
    "Tilt, torque: root mean square over all steps to the end or the fall. Reward: mean of a step.",
)

#: For tasks with a setpoint.
STANDING = (
    "Settling: median time from which the tilt stays within 1 deg.",
    "Ball: largest distance from the setpoint, mean over episodes.",
)

#: Columns that replace others where robots are pushed.
_PUSHED: dict[str, tuple[str, Callable[[Result], str]]] = {
    "settling (s)": (
        "recovery (s)",
        lambda r: "none" if r.recovery_time is None else f"{r.recovery_time:.2f}",
    ),
    "ball (m)": ("ball rms (m)", lambda r: f"{r.ball_rms:.3f}"),
}


#: Why success does not measure robustness.
PUSH_NOTE = "After a push near the end no controller can succeed: judge robustness by upright, recovery and ball."

#: Why the PID rarely succeeds.
PID_NOTE = "pid controls only the tilt: the ball drifts away, so it rarely succeeds even if it stays upright."


def _columns(task: str, pushed: bool) -> dict[str, Callable[[Result], str]]:
    """The columns of a task: its own metrics, if it has any, in place of the metrics for balancing at a setpoint."""
    description = description_of(task)
    metrics = description["metrics"]
    columns = {}
    for name, cell in _COLUMNS.items():
        if pushed and name in _PUSHED and not description["command"]:
            name, cell = _PUSHED[name]
            if metrics and name != "recovery (s)":
                continue
        elif metrics and name in _PUSHED:
            continue
        columns[name] = cell
    for metric in metrics:
        columns[metric_label(metric)] = _metric(metric["name"])
    return columns


def metric_label(metric: Mapping[str, str]) -> str:
    """Name and unit of a metric of a task, as a column title."""
    unit = f" ({metric['unit']})" if metric["unit"] else ""
    return metric["name"].replace("_", " ") + unit


def _metric(name: str) -> Callable[[Result], str]:
    def cell(result: Result) -> str:
        value = result.metrics[name]
        return "none" if value is None else f"{value:.3g}"

    return cell


def rows(results: Sequence[Result], task: str) -> list[list[str]]:
    """The header, and one row per controller."""
    columns = _columns(task, _pushed(results))
    return [list(columns), *([cell(result) for cell in columns.values()] for result in results)]


def _pushed(results: Sequence[Result]) -> bool:
    return any(result.pushes for result in results)


def legend(results: Sequence[Result], task: str) -> list[str]:
    """The meaning of the columns."""
    description, notes = description_of(task), list(LEGEND)
    metrics = description["metrics"]
    if _pushed(results) and not description["command"]:
        tilt, distance = results[0].recovery_limits
        notes.append(
            f"Recovery: median time from a push until the tilt is back within {math.degrees(tilt):.3g} deg and the "
            f"ball within {distance:g} m of the setpoint and stay there until the next push, for at least 1 s; a push "
            "that comes too early censors the time (Kaplan-Meier); a fall counts as never. None: fewer than half "
            "recover in the time between pushes."
        )
        if not metrics:
            notes += ["Ball: root mean square of the distance from the setpoint.", PUSH_NOTE]
    elif not metrics:
        notes += STANDING
    if metrics:
        own = [f"{metric['name'].replace('_', ' ').capitalize()}: {metric['doc']}" for metric in metrics]
        notes.append("; ".join(own) + "; means over the episodes that ran to completion.")
    return notes


def print_table(results: Sequence[Result], task: str, options: Mapping[str, Any]) -> None:
    """Prints one row per controller within `WIDTH` columns, the conditions, and the meaning of the columns.

    Args:
        results: one per controller.
        task: name of the task.
        options: their shared options of the environment.
    """
    header, *body = rows(results, task)
    # Units have a separate line, so that names of controllers have room.
    lines = [
        [name.partition(" (")[0] for name in header],
        [name.partition(" (")[2].rstrip(")") for name in header],
        *body,
    ]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    # Tables of many metrics are wider than that: names stay legible.
    widths[0] = min(widths[0], max(LEAST_NAME, WIDTH - sum(width + 2 for width in widths[1:])))
    lines.insert(2, ["-" * width for width in widths])
    for first, *rest in lines:
        cells = [_shortened(first, widths[0]).ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True)]
        print("  ".join(cells).rstrip())
    conditions = [f"{results[0].episodes} episodes each", f"model {results[0].model}", *differences(task, options)]
    notes = [", ".join(conditions) + ".", success_rule(task, options), *legend(results, task)]
    if any(result.controller == "pid" for result in results):
        notes.append(PID_NOTE)
    print()
    for note in filter(None, notes):
        print(textwrap.fill(note, WIDTH))


def _shortened(name: str, width: int) -> str:
    """A name, or only its end if it is too long."""
    return name if len(name) <= width else f"…{name[1 - width :]}"
