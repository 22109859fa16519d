"""Side by side.

The controllers that hold a position, each with its default options and the last stage, at 100 Hz: tilts and pushes as
above. Their laws and tuning rules are in [laws](laws.md).
"""

import ballbot_rs as bb
from validation.claim import Claim
from validation.controllers.trials import basin, pushes
from validation.page import table
from validation.topic import Findings

CONTROLLERS = ("lqr", "lqi", "cascade_pid", "hierarchical_sliding_mode")


def run() -> Findings:
    """Basins and pushes of all of them."""
    rows, claims = [], []
    for name in CONTROLLERS:
        law = bb.Controller(name, control_dt=0.01)
        measured = basin(law), pushes(law, 0.0), pushes(law, 0.1)
        rows.append([f"`{name}`", *(f"{value:.2f}" for of in measured for value in (of.min(), of.mean()))])
        stands = float(bb.evaluate(name, episodes=100).survival_rate)
        claims.append(Claim(f"share of upright robots from the starts of the task, {name}", stands, 1.0, 0.0))
    head = [
        "controller",
        "tilt, worst (deg)",
        "mean",
        "push at once, worst (N·s)",
        "mean",
        "push in 0.1 s, worst (N·s)",
        "mean",
    ]
    return Findings(claims, None, table(head, rows))
