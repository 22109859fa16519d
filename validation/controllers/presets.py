"""Other robots.

A tenth of the scenarios on the other presets, with their numbers scaled: tilts by the lean that a robot can hold,
pushes by the impulse that takes its capture point there, motions by the traction that they take
([scenarios](scenarios.md)). The friction of the wheels' bearings, which only `asroballet` has, leaves static laws in
a limit cycle. `rezero` falls from pushes at once that are far below $J_c$, as such a push lifts a wheel off its ball;
within 0.1 s it stands all of it.
"""

from typing import Final

from ballbot_rs._core import CONTROLLERS, ROBOTS
from ballbot_rs.scenarios.matrix import cell, unit
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from validation.claim import Claim
from validation.page import table
from validation.topic import Findings

SCENARIOS: Final = ("S2-rest", "S3-at-once", "S3-slow", "S10-4s", "S13-6s")
#: `pid` does not follow motions, and `mppi` takes too long for maps.
NAMES: Final = tuple(name for name in CONTROLLERS if name not in ("pid", "mppi"))


def run() -> Findings:
    """The scenarios on all presets except the paper's."""
    parts, claims = [], []
    for robot in ROBOTS:
        if robot == "paper":
            continue
        found = {(one.controller, one.scenario.id): one for one in run_scenarios(NAMES, SCENARIOS, robot=robot)}
        rows = []
        for name in SCENARIOS:
            scenario = load()[name]
            rows.append([scenario.title, unit(scenario), *(cell(found.get((one, name))) for one in NAMES)])
        parts += [f"`{robot}`:", table([robot, "unit", *(f"`{name}`" for name in NAMES)], rows)]
        fallen = sum(int(one.metrics["fell"].sum()) for one in found.values() if not one.scenario.is_map)
        claims.append(Claim(f"robots that fall in motions, {robot}", float(fallen), 0.0, 0.0, "", True))
    return Findings(claims, None, "\n\n".join(parts))
