r"""Friction of the wheels on the ball.

The torque at which wheels slip is proportional to the coefficient: three equal torques break loose at
$\tau = \mu N\ (f/\tau)^{-1}$ ([stick and
slip](verification.md#stick-and-slip-the-torque-at-which-the-wheels-break-loose-whatever-the-heading)). The policy
limits its torques to 0.9 of the torque that tilts the upright robot without slip at $\mu = 1$; LQR limits them by the
wheel loads of the leaning robot ([controllers](controllers.md)), for the same $\mu$. At a lower coefficient the rest of
the torque spins the wheels up, unless the controller ends the slip, as LQR does. LQR made for the robot uses limits for
the actual friction. The static coefficient is 1.1 times the coefficient in the table.

The friction of the floor matters less: at 0.1 no start falls.
"""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.closed_forms import friction_limit
from validation.robots.sweep import EPISODES, PAPER, POLICY, Measured, Sweep, drawn
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CLAIMED = (0.2, 0.5)
SWEEP = Sweep(
    "friction coefficient of the wheels",
    (1.0, 0.7, 0.5, 0.4, 0.3, 0.2, 0.1),
    lambda friction: drawn("wheel_dynamic_friction", "abs", friction),
    0.005,
    '--set \'events=[{"term": "wheel_dynamic_friction", "range": [0.7, 0.7]}]\'',
    lambda friction: with_friction(friction),
)


def with_friction(friction: float) -> bb.Params:
    """The paper's robot with this dynamic friction of its wheels; static friction in proportion."""
    share = friction / PAPER.wheel_dynamic_friction
    return PAPER.replace(wheel_dynamic_friction=friction, wheel_static_friction=share * PAPER.wheel_static_friction)


def slip_torque(friction: float) -> float:
    """Three equal torques at which the wheels break loose in `contact`, N·m."""
    return largest(partial(friction_limit.grips, with_friction(friction), "contact", 0.0), 0.0, 2.0, to=1e-5)


def claims() -> list[Claim]:
    """The onset of slip, and the floor."""
    found = [
        Claim(
            f"three equal torques at which the wheels slip, μ = {friction:g}",
            slip_torque(friction),
            friction_limit.slip_torque(with_friction(friction)),
            2e-3,
            "N·m",
        )
        for friction in _CLAIMED
    ]
    slippery = drawn("floor_dynamic_friction", "abs", 0.1)
    for name, source in (("LQR", "lqr"), ("policy", POLICY)):
        upright = bb.evaluate(source, episodes=EPISODES, **slippery).survival_rate
        found.append(Claim(f"fraction of upright robots, floor μ = 0.1, {name}", upright, 1.0, 0.0))
    return found


def run() -> Findings:
    """Sweeps the friction of the wheels."""
    measured = Measured(SWEEP)
    lines = [friction_limit.slip_torque(with_friction(friction)) for friction in SWEEP.values]
    dots = [slip_torque(friction) for friction in SWEEP.values]
    held = float(np.max(bb.Batch(1).max_wheel_torque))

    def draw(fig: "Figure") -> None:
        left, middle, right = fig.subplots(1, 3)
        left.plot(SWEEP.values, lines, label="closed form")
        left.plot(SWEEP.values, dots, "o", label="contact")
        left.axhline(held, color="#868e96", linestyle="--", label="controllers' limit")
        left.set(xlabel=SWEEP.label, ylabel="torque at which wheels slip (N·m)")
        left.legend()
        measured.draw(middle, right)

    return Findings(claims(), draw, measured.markdown(), (10.0, 3.2))
