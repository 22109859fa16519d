"""Other robots.

A tenth of the scenarios on the other presets, with scaled values: tilts relative to the largest lean that the robot can
hold, pushes relative to the impulse $J_c$ that moves its capture point to this limit, motions relative to the traction
that they need ([scenarios](scenarios.md)). Bearing friction of the wheels, which only `asroballet` has, leaves static
controllers in a limit cycle. `rezero` withstands pushes of 20 N·s at once, and of 37 to 39 N·s within 0.1 s, with
`lqr_pi` 28.
"""

from typing import Final

from ballbot_rs._core import CONTROLLERS, ROBOTS
from ballbot_rs.scenarios.matrix import cell, unit
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from validation.claim import Claim
from validation.controllers.planners import PLANNERS, YIELDING
from validation.page import table
from validation.topic import Findings

SCENARIOS: Final = ("S2-rest", "S3-at-once", "S3-slow", "S10-4s", "S13-6s")
#: `pid` does not follow motions, planners take too long for maps, and `admittance` yields.
NAMES: Final = tuple(name for name in CONTROLLERS if name not in ("pid", *PLANNERS, *YIELDING))


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
