r"""A center of mass off the mast.

With the CoM at $(d, 0, l)$ in the body frame (`body_com_offset`, `body_com_height`) the robot leans in equilibrium, to
the opposite side, by $\varphi = \arctan(d/l)$. A controller that assumes the mast to be vertical in equilibrium
sees this tilt as a constant error. LQR commands $-K x$; at rest the torque must be zero, so that with the gains of
position, $k_x$, and of tilt, $k_\vartheta$, the ball rests off its setpoint by

$$e = \frac{k_\vartheta}{k_x}\ \varphi,$$

for large $\varphi$ too. Success ends where $e$ passes 0.1 m, long before the robot falls. LQR made for the robot uses
the tilt from the equilibrium in $x$ and comes to rest at the setpoint.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SECONDS = 20.0
_CLAIMED = (0.002, 0.01)
SWEEP = Sweep(
    "offset of the CoM (mm)",
    (0.0, 2.0, 4.0, 6.0, 10.0, 14.0, 18.0, 22.0),
    lambda mm: drawn("body_com_offset", "abs", (1e-3 * mm, 0.0)),
    0.1,
    '--set \'events=[{"term": "body_com_offset", "range": [[0.002, 0.002], [0, 0]]}]\'',
    lambda mm: offset_robot(1e-3 * mm),
)


def offset_robot(offset: float) -> bb.Params:
    """The paper's robot with its CoM off the mast, m."""
    return PAPER.replace(body_com_offset=(offset, 0.0))


def lean(offset: float) -> float:
    """Tilt in equilibrium, rad."""
    return float(np.arctan2(offset, PAPER.body_com_height))


def displacement(offset: float) -> float:
    """Offset from the setpoint, m, at which LQR designed for the mast holds the ball: its torques vanish there."""
    gain = bb.Lqr(control_dt=0.01).gain
    # Columns: position x, and tilt about y, which is negative.
    return float(np.linalg.lstsq(gain[:, :1], gain[:, 3] * lean(offset), rcond=None)[0][0])


def at_rest(offset: float, designed_for: bb.Params) -> tuple[float, float]:
    """Tilt of the mast, rad, and ball position x, m, at which LQR comes to rest in `contact`."""
    robot = bb.Ballbot(offset_robot(offset), "contact", 0.002)
    law = bb.Lqr(designed_for, 0.01)
    robot.reset(bb.State.at_equilibrium(robot.params))
    for _ in range(round(_SECONDS / law.control_dt)):
        robot.step(law(robot.state), 5)
    return robot.state.tilt, float(robot.state.ball_position[0])


def claims() -> list[Claim]:
    """Tilt and displacement at rest."""
    found = []
    for offset in _CLAIMED:
        tilt, own = at_rest(offset, offset_robot(offset))
        at = f"{1e3 * offset:g} mm"
        found.append(Claim(f"tilt at rest, CoM off by {at}", np.degrees(tilt), np.degrees(lean(offset)), 1e-6, "deg"))
        found.append(Claim(f"ball at rest, {at}, LQR made for it", own, 0.0, 1e-6, "m", absolute=True))
        ours, expected = at_rest(offset, PAPER)[1], displacement(offset)
        found.append(Claim(f"ball at rest, {at}, nominal LQR", ours, expected, 1e-6, "m"))
    return found


def run() -> Findings:
    """Sweeps the offset."""
    measured = Measured(SWEEP)
    offsets: Array = 1e-3 * np.array(SWEEP.values[:6])
    rest = [at_rest(offset, PAPER)[1] for offset in offsets]

    def draw(fig: "Figure") -> None:
        left, middle, right = fig.subplots(1, 3)
        left.plot(1e3 * offsets, [displacement(offset) for offset in offsets], label="closed form")
        left.plot(1e3 * offsets, rest, "o", label="nominal LQR, contact")
        left.set(xlabel=SWEEP.label, ylabel="ball from the setpoint (m)")
        left.legend()
        measured.draw(middle, right)

    return Findings(claims(), draw, measured.markdown(), (10.0, 3.2))
