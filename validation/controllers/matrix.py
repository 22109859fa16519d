r"""The matrix.

All controllers in all [scenarios](scenarios.md), with default options, the same episodes and the same last stage;
[other tunings](#default-published-and-tuned) are below. In scenarios that search for a limit, the number is the largest
tilt or push up to which all robots recover, in the worst of 12 or 24 directions. In the others it is the error in the
worst direction or, over random episodes, the mean of the worse half (CVaR 0.5). The column `policy` is the balancing
policy that comes with the package; it and `pid` have no scenarios with motions. `mppi` and `nmpc` have only scenarios
with few robots, because their decisions take milliseconds.

No single number ranks the controllers. The figure has a row per controller: the error on a fast circle, the worst-case
push limit with increasing delay, and the worst-case tilt limit with decreasing friction of the wheels; below, the tilts
from which the robot recovers, by direction.
"""

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ballbot_rs import _assets
from ballbot_rs._core import CONTROLLERS
from ballbot_rs.media.figures.labels import short
from ballbot_rs.scenarios.matrix import cell, unit
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from validation.claim import Claim
from validation.controllers.planners import YIELDING
from validation.page import table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Scenarios of laws whose decisions take milliseconds.
_FEW: Final = {
    "mppi": {"S10-3.1s", "S13-6s", "S13-4s", "S15-6s"},
    "nmpc": {name for name, one in load().items() if one.seeds == 1 and not one.is_map},
}
POLICY: Final = "policy"

Found = Mapping[tuple[str, str], Outcome]


def names() -> list[str]:
    """The controllers of the table."""
    return [*(name for name in CONTROLLERS if name not in YIELDING), POLICY]


@cache
def outcome(name: str, scenario: str) -> Outcome | None:
    """One outcome; None if the controller does not run the scenario."""
    if name in _FEW and scenario not in _FEW[name]:
        return None
    source = _assets.path("policies/balance.onnx") if name == POLICY else name
    (found,) = run_scenarios([source], [scenario])
    return found if found.skipped is None else None


@cache
def measured() -> dict[tuple[str, str], Outcome]:
    """Outcomes by controller and scenario."""
    found = {(name, scenario): outcome(name, scenario) for name in names() for scenario in load()}
    return {place: one for place, one in found.items() if one is not None}


def run() -> Findings:
    """All controllers in all scenarios."""
    found = measured()
    return Findings(claims(found), lambda fig: draw(fig, found), _tables(found), (9.0, 6.8))


def claims(found: Found) -> list[Claim]:
    """Requirements for the best controllers: by how much they are missed."""

    def best(scenario: str, largest: bool) -> float:
        scores = [outcome.score for (_, name), outcome in found.items() if name == scenario]
        return max(scores) if largest else min(scores)

    def least(what: str, value: float, scenario: str, of: str) -> Claim:
        return Claim(f"{what}, missing to {value:g} {of}", max(value - best(scenario, True), 0.0), 0.0, 0.0, of, True)

    def most(what: str, value: float, scenario: str, of: str, factor: float) -> Claim:
        above = max(factor * best(scenario, False) - value, 0.0)
        return Claim(f"{what}, above {value:g} {of}", above, 0.0, 0.0, of, True)

    return [
        least("largest tilt in the worst direction", 27.0, "S2-rest", "deg"),
        least("largest push in the worst direction", 2.05, "S3-at-once", "N·s"),
        most("circle in 6 s", 3.0, "S13-6s", "mm", 1e3),
        most("circle in 4 s", 10.0, "S13-4s", "mm", 1e3),
        most("lemniscate in 12 s", 0.5, "S15-12s", "mm", 1e3),
        most("1 m in 3.1 s", 5.0, "S10-3.1s", "mm", 1e3),
        most("offset under 1 N", 1.0, "S6-1N", "mm", 1e3),
        most("offset of a center of mass off by 5 mm", 1.0, "S8-5mm", "mm", 1e3),
        least("largest tilt with a delay of 50 ms", 4.0, "S18-4deg", "deg"),
        _mean(found),
    ]


def _mean(found: Found) -> Claim:
    """The mean over all episodes, where the score is the mean of the worse half."""
    of = [
        float(one.metrics["rms_error"].mean())
        for (_, name), one in found.items()
        if name == "S22-6s" and not one.metrics["fell"].any()
    ]
    above = max(1e3 * min(of) - 20.0, 0.0)
    return Claim("circle in 6 s with sensors, delay and mild events, mean above 20 mm", above, 0.0, 0.0, "mm", True)


def _tables(found: Found) -> str:
    scenarios, columns = load(), names()
    half = (len(columns) + 1) // 2
    parts = []
    for some in (columns[:half], columns[half:]):
        rows = [
            [f"{name}: {scenario.title}", unit(scenario), *(cell(found.get((one, name))) for one in some)]
            for name, scenario in scenarios.items()
        ]
        parts.append(table(["scenario", "unit", *(f"`{one}`" for one in some)], rows))
    return "\n\n".join([*parts, "Random episodes, fraction of successes with Wilson's 95 % interval:", _random(found)])


def _random(found: Found) -> str:
    random = [name for name, scenario in load().items() if scenario.seeds > 1]
    rows = []
    for name in names():
        outcomes = [found.get((name, scenario)) for scenario in random]
        if any(outcomes):
            rows.append([f"`{name}`", *("-" if one is None else _share(one) for one in outcomes)])
    return table(["controller", *random], rows)


def _share(outcome: Outcome) -> str:
    low, high = outcome.interval()
    return f"{100 * outcome.success_rate:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def draw(fig: "Figure", found: Found) -> None:
    """Tracking, and pushes and tilts under delay and on slippery wheels, a row per controller; basins below."""
    from matplotlib.lines import Line2D

    grid = fig.add_gridspec(2, 3, height_ratios=(1.5, 1.0))
    shown = [name for name in names() if (name, "S3-at-once") in found]
    left = fig.add_subplot(grid[0, 0])
    middle, right = (fig.add_subplot(grid[0, column], sharey=left) for column in (1, 2))
    for row, name in enumerate(shown):
        if (name, "S13-4s") in found:
            left.plot(1e3 * found[name, "S13-4s"].score, row, **_DOTS[0])
        for axes, scenarios in ((middle, _DELAYS), (right, _FRICTIONS)):
            scores = [found[name, scenario].score for scenario in scenarios.values() if (name, scenario) in found]
            axes.plot([min(scores), max(scores)], [row, row], color="#868e96", linewidth=0.7)
            for score, dot in zip(scores, _DOTS, strict=False):
                axes.plot(score, row, **dot)
    left.set_yticks(range(len(shown)), [short(name) if name != POLICY else name for name in shown])
    left.invert_yaxis()
    for axes in (left, middle, right):
        axes.set_title("\n\n")
        axes.margins(x=0.08)
    left.set(xlabel="circle in 4 s, error (mm rms)", xlim=(0, None))
    middle.set(xlabel="worst push (N\u00b7s)", xlim=(0, None))
    right.set(xlabel="worst tilt (deg)", xlim=(0, None))
    for axes, scenarios, title in ((middle, _DELAYS, "delay (ms)"), (right, _FRICTIONS, "friction of the wheels")):
        axes.tick_params(labelleft=False)
        keys = [Line2D([], [], label=f"{x:g}", **dot) for x, dot in zip(scenarios, _DOTS, strict=False)]
        options: dict[str, Any] = {
            "handletextpad": 0.0,
            "columnspacing": 0.4,
            "ncols": len(keys),
            "title": title,
            "fontsize": "small",
        }
        above = axes.legend(handles=keys, loc="lower right", bbox_to_anchor=(1.0, 1.0), **options)
        # The titles keep its room: with it in the layout, a wide legend would push the other panels away.
        above.set_in_layout(False)
    _basins(fig.add_subplot(grid[1, :]), found)


_DELAYS: Final = {0: "S3-at-once", 10: "S18-10ms", 30: "S18-30ms", 50: "S18-50ms"}
_FRICTIONS: Final = {1.0: "S2-rest", 0.6: "S19-0.6", 0.3: "S19-0.3"}
#: Marks from the nominal case on.
_DOTS: Final[tuple[dict[str, Any], ...]] = (
    {"marker": "o", "color": "#0b7285", "linestyle": "none", "markersize": 7},
    {"marker": "s", "color": "#d9480f", "linestyle": "none", "markersize": 5},
    {"marker": "^", "color": "#5f3dc4", "linestyle": "none", "markersize": 5},
    {"marker": "x", "color": "#212529", "linestyle": "none", "markersize": 5},
)


def _basins(axes: "Axes", found: Found) -> None:
    from ballbot_rs.media.figures.panels import MARKERS, look

    for number, name in enumerate(("lqr", "cascade_pid", "lqr_pi", POLICY)):
        largest = found[name, "S2-rest"].largest
        azimuths = np.degrees(np.arange(len(largest)) * 2.0 * np.pi / len(largest))
        style: dict[str, Any] = {**look(number), "marker": MARKERS[number], "markersize": 9 - 2 * number}
        axes.plot(azimuths, largest, label=short(name) if name != POLICY else name, **style)
    axes.set(xlabel="direction of the tilt (deg)", ylabel="largest tilt (deg)", ylim=(0, None), xlim=(-5, 350))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
