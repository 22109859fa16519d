r"""Fig. 7: initial inclines of 1°, 2° and 3°.

The PID at 1 kHz from rest at an incline in $\theta_x$, in `rigid`, with two limits of the wheel torques: what
traction allows (`Pid`'s default, 0.9 of the torque at which a wheel slips), and the ±5 N·m that the paper shows.
Within its traction the robot recovers from all three, and from many times more. With ±5 N·m the derivative's answer
to any tilt beyond a degree or two breaks the wheels loose; wheels that spin up do not push as commanded, and the robot
falls. More torque makes it worse.

The table below has the largest incline that each variant recovers from, the worst of four directions of lean, to
0.1°.
"""

from typing import TYPE_CHECKING

import numpy as np

from validation.claim import Claim
from validation.page import table
from validation.paper_replication.loop import MAPS, PRINTED_TORQUE, balance, largest_recovered
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INCLINES = (1.0, 2.0, 3.0)
_LIMITS = {"what traction allows": None, "±5 N·m": PRINTED_TORQUE}


def run() -> Findings:
    """The three inclines, and the largest incline of each variant."""
    runs = {
        (model, incline, name): balance(model, (incline, 0.0), max_torque=limit, seconds=2.0)
        for model in ("rigid", "contact")
        for incline in INCLINES
        for name, limit in _LIMITS.items()
    }
    traction = next(iter(_LIMITS))
    claims = [
        Claim(
            f"`{model}`, {incline:g}°, torques that traction allows: tilt after 2 s",
            float(np.degrees(runs[model, incline, traction].tilt[-1])),
            0.0,
            2e-3,
            "deg",
            absolute=True,
        )
        for model in ("rigid", "contact")
        for incline in INCLINES
    ]
    largest = {
        (model, mapping, name): largest_recovered(model, mapping, limit)
        for model in ("rigid", "contact")
        for mapping in MAPS
        for name, limit in _LIMITS.items()
    }
    rows = [
        [f"`{model}`, `{mapping}`", *(f"{largest[model, mapping, name]:.1f}" for name in _LIMITS)]
        for model in ("rigid", "contact")
        for mapping in MAPS
    ]
    most = max(value for (_, _, name), value in largest.items() if name != traction)
    capped = min(value for (_, _, name), value in largest.items() if name == traction)
    compared = Comparison(
        "initial inclines of 1°, 2°, 3°",
        "Section III-B, Fig. 7",
        "all stabilized",
        f"stabilized, up to {capped:.1f}°, with torques that traction allows; with ±5 N·m up to {most:.1f}° at most",
        "±5 N·m is ten times what a wheel can transmit: the wheels spin up and the robot falls",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        axes = fig.subplots(1, 3)
        for ax, incline in zip(axes, INCLINES, strict=True):
            for (name, _), color in zip(_LIMITS.items(), (COLORS[0], COLORS[1]), strict=True):
                r = runs["rigid", incline, name]
                shown = r.times <= 0.5
                ax.plot(r.times[shown], np.degrees(r.tilts[shown, 0]), color=color, label=name)
                if r.fell:
                    ax.annotate("falls", (0.95, 0.06), xycoords="axes fraction", color=color, ha="right")
            ax.axhline(0.0, color=INK, linewidth=0.6)
            ax.set(title=f"{incline:g}°", xlabel="time (s)", xlim=(0.0, 0.5), ylim=(-2.0 * incline, 2.0 * incline))
        axes[0].set_ylabel("tilt about x (deg)")
        axes[0].legend(loc="upper right")

    head = ["largest incline (deg), torques within", *_LIMITS]
    return Findings(claims, draw, table(head, rows), compared=(compared,))
