"""Results as rows of a page."""

import math

import ballbot_rs as bb
from ballbot_rs._text_table import metric_label
from ballbot_rs.envs.registration import description_of


def head(task: str) -> list[str]:
    """Header of a table of results of a task."""
    metrics = [metric_label(metric) for metric in description_of(task)["metrics"]]
    return ["judge", "controller", "episodes", "success", "upright", *metrics]


def row(judge: str, controller: str, result: bb.Result) -> list[str]:
    """A row of the table: means with their 95 % intervals."""
    success = _percent(result.success_rate, result.success_interval)
    upright = f"{100.0 * result.survival_rate:.4g} %"
    metrics = [_mean(result, name) for name in result.metrics]
    return [judge, controller, str(result.episodes), success, upright, *metrics]


def measure(result: bb.Result, name: str) -> float:
    """A metric of the task by name; "failures": the fraction of episodes without success, "missed_goals": of goals."""
    if name == "failures":
        return 1.0 - result.success_rate
    if name == "missed_goals":
        return 1.0 - (result.metrics["goals_held"] or 0.0) * result.survival_rate
    value = result.metrics[name]
    return float("nan") if value is None else value


def interval(result: bb.Result, name: str) -> tuple[float, float]:
    """The 95 % interval of `measure`; NaN if there is none."""
    if name == "failures":
        low, high = result.success_interval
        # Without the rounding of 1 - 1.
        return round(1.0 - high, 12), round(1.0 - low, 12)
    found = result.metric_intervals["goals_held" if name == "missed_goals" else name]
    if found is None:
        return math.nan, math.nan
    if name == "missed_goals":
        low, high = found
        return 1.0 - high * result.survival_rate, 1.0 - low * result.survival_rate
    return found


def _percent(share: float, interval: tuple[float, float]) -> str:
    low, high = (100.0 * bound for bound in interval)
    return f"{100.0 * share:.4g} % ({low:.1f} … {high:.1f})"


def _mean(result: bb.Result, name: str) -> str:
    mean, interval = result.metrics[name], result.metric_intervals[name]
    if mean is None or interval is None:
        return "none"
    low, high = interval
    return f"{mean:.3g} ({low:.3g} … {high:.3g})"
