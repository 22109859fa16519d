"""Side by side.

The controllers that hold a position, each with its default options and the last stage, at 100 Hz: tilts and pushes as
above. Their laws and tuning rules are in [laws](laws.md).
"""

import ballbot_rs as bb
from validation.claim import Claim
from validation.controllers import trials
from validation.topic import Findings

CONTROLLERS = ("lqr", "lqi", "cascade_pid", "hierarchical_sliding_mode")


def run() -> Findings:
    """Basins and pushes of all of them."""
    claims, stood = [], {}
    for name in CONTROLLERS:
        stood[f"`{name}`"] = trials.measure(bb.Controller(name, control_dt=0.01))
        upright = float(bb.evaluate(name, episodes=100).survival_rate)
        claims.append(Claim(f"share of upright robots from the starts of the task, {name}", upright, 1.0, 0.0))
    return Findings(claims, None, trials.side_by_side("controller", stood))
