r"""A slope.

On a floor tilted by $\theta$ (`floor_tilt`) a robot is at rest only if it leans uphill, with the common center of
mass of ball and body above the floor contact, and if its motors hold it ([slope](derivations.md#slope)). From the
floor's normal the lean is

$$\lambda = \theta + \arcsin\frac{(M_k + M_b) r_k \sin\theta}{M_b l},$$

more than twice the slope. A controller that assumes level ground commands $-K x$. At rest this must be the torques
$\tau$ that hold the robot, so under LQR the robot rests downhill of its setpoint by $e$, where

$$-k_x e = \tau + k_\vartheta \lambda,$$

with the gains of position, $k_x$, and of tilt, $k_\vartheta$, as long as this lean is within LQR's `max_lean`, 10°. On
steeper slopes, above some 4°, it rolls downhill, upright. Success ends where $\lambda$ passes 1°, at a slope of
0.43°. Tasks start robots along the floor's normal.
"""

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

_SECONDS = 20.0
_CLAIMED = (0.5, 3.0)
SWEEP = Sweep(
    "slope (deg)",
    (0.0, 0.2, 0.4, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0),
    lambda degrees: drawn("floor_tilt", "abs", (0.0, np.radians(degrees))),
    0.1,
    '--set \'events=[{"term": "floor_tilt", "range": [[0, 0], [0.00349, 0.00349]]}]\'',
)


def on_slope(degrees: float) -> bb.Params:
    """The paper's robot on a floor that slopes down towards +x."""
    return PAPER.replace(floor_tilt=(0.0, np.radians(degrees)))


def lean(degrees: float) -> float:
    """Lean from the floor's normal at rest, rad."""
    p, sine = PAPER, np.sin(np.radians(degrees))
    common = (p.ball_mass + p.body_mass) * p.ball_radius / (p.body_mass * p.body_com_height)
    return float(np.radians(degrees) + np.arcsin(common * sine))


def displacement(degrees: float) -> float:
    """Distance downhill of the setpoint, m, at which LQR for a level floor holds the ball."""
    gain = bb.Lqr(control_dt=0.01).gain
    # Columns: position x, and tilt about y, which is negative.
    requested = gain[:, 3] * lean(degrees) - np.array(on_slope(degrees).holding_torques())
    return float(np.linalg.lstsq(gain[:, :1], requested, rcond=None)[0][0])


def at_rest(model: str, degrees: float) -> tuple[float, float]:
    """Lean from the floor's normal, rad, and ball position x, m, at which LQR for a level floor comes to rest."""
    robot = bb.Ballbot(on_slope(degrees), model, 0.002)
    law = bb.Lqr(control_dt=0.01)
    robot.reset(bb.State.at_equilibrium(robot.params))
    for _ in range(round(_SECONDS / law.control_dt)):
        robot.step(law(robot.state), 5)
    return robot.state.tilt, float(robot.state.ball_position[0])


def claims() -> list[Claim]:
    """Lean and displacement at rest."""
    found = []
    for model in ("contact", "rigid"):
        for degrees in _CLAIMED:
            tilt, place = at_rest(model, degrees)
            at = f"{degrees:g}°, {model}"
            found.append(Claim(f"lean at rest, {at}", np.degrees(tilt), np.degrees(lean(degrees)), 1e-6, "deg"))
            found.append(Claim(f"ball at rest, {at}", place, displacement(degrees), 1e-6, "m"))
    return found


def run() -> Findings:
    """Sweeps the slope."""
    lines = [displacement(degrees) for degrees in SWEEP.values]
    dots = [at_rest("contact", degrees)[1] for degrees in SWEEP.values]
    return Measured(SWEEP).findings(claims(), "ball from the setpoint (m)", lines, dots)
