r"""Section III-A: falling above 30°.

The paper states that the robot "falls immediately" once the tilt exceeds 30°, and gives no reason. Traction is a
reason. To hold a tilt, the ball has to accelerate under the body, and the wheels have to transmit the force. The
largest tilt is where the first wheel's traction reaches $\mu N$; it depends on the direction of the lean, and the worst
direction counts. The closed form, and what `contact` and `rigid` do, are on [the other page](verification.md). With the
printed wheel friction the limit is 29.7° (dynamic, 1.0) to 31.6° (static, 1.1).

The points are the tilt at which the model without slip, `spatial`, finds the traction to be used up: the torques that
hold the tilt come from its equations of motion, the loads and tractions from `SpatialModel.contacts`.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.closed_forms import holdable_tilt
from validation.closed_forms.holdable_tilt import AZIMUTHS, FRICTIONS
from validation.mechanics import Array
from validation.search import largest
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINTED_DEGREES = 30.0


def run() -> Findings:
    """The limit over friction, and the limit of the model without slip at the worst azimuth."""
    frictions = np.linspace(0.3, 1.3, 21)
    limits = {
        float(mu): np.degrees(holdable_tilt.largest_tilts(holdable_tilt.robot(float(mu))))
        for mu in (*frictions, *FRICTIONS)
    }
    claims: list[Claim] = []
    measured: list[float] = []
    for mu in FRICTIONS:
        azimuth = float(AZIMUTHS[int(limits[mu].argmin())])
        measured.append(modeled_limit(holdable_tilt.robot(mu), azimuth))
        what = f"largest tilt held at μ = {mu:g}, `SpatialModel`"
        claims.append(Claim(what, measured[-1], float(limits[mu].min()), 1e-9, "deg"))
    dynamic, static = float(limits[1.0].min()), float(limits[1.1].min())
    compared = Comparison(
        "largest tilt",
        "Section III-A",
        "falls above 30°",
        f"{dynamic:.1f}° to {static:.1f}° before a wheel slips (μ = 1.0 to 1.1)",
        "no reason is printed; traction gives the same number",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK, MODEL_COLORS

        ax = fig.subplots()
        worst = np.array([limits[float(mu)].min() for mu in frictions])
        best = np.array([limits[float(mu)].max() for mu in frictions])
        ax.fill_between(frictions, worst, best, color=COLORS[4], alpha=0.3, linewidth=0, label="other directions")
        ax.plot(frictions, worst, color=INK, label="worst direction of lean")
        ax.plot(FRICTIONS, measured, "o", markersize=5, color=MODEL_COLORS["spatial"], label="spatial")
        ax.axhline(PRINTED_DEGREES, color=INK, linestyle="--", linewidth=0.8, label="printed")
        ax.set(xlabel="friction coefficient of the wheels", ylabel="largest tilt held (deg)", ylim=(0.0, 60.0))
        ax.legend(loc="upper left")

    return Findings(claims, draw, compared=(compared,))


def holding_torques(params: bb.Params, tilt: float, azimuth: float) -> tuple[Array, bb.Contacts]:
    """Wheel torques under which a robot at rest holds its tilt towards `azimuth`, and the resulting forces."""
    model = bb.SpatialModel(params, ball_spins_about_vertical=False)
    about = tilt * np.array([-np.sin(azimuth), np.cos(azimuth)])
    quaternion = bb.State.at_rest(params, about).body_quaternion
    rest = np.zeros(5)
    free = model.accelerations(quaternion, rest, np.zeros(3))
    per_torque = np.array([model.accelerations(quaternion, rest, unit) - free for unit in np.eye(3)]).T
    torques = np.linalg.solve(per_torque[2:], -free[2:])
    return torques, model.contacts(quaternion, rest, torques)


def modeled_limit(params: bb.Params, azimuth: float) -> float:
    """The largest tilt held towards `azimuth`, deg."""

    def holds(tilt: float) -> bool:
        contacts = holding_torques(params, tilt, azimuth)[1]
        used = np.abs(contacts.wheel_tractions) - params.wheel_dynamic_friction * contacts.wheel_normal_forces
        return bool(np.all(used <= 0.0))

    return float(np.degrees(largest(holds, 0.0, 1.4, to=1e-11)))
