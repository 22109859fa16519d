r"""Friction of the rollers.

The rollers of a wheel drag the ball along the wheel's free direction, with $\mu_0 + \mu_1\lvert h_i\rvert$ times its
load at the speed $h_i$ ([losses](derivations.md#losses)). Upright at the speed $v$ towards a wheel, with the load $N_0$
of each wheel, the drag is $2\mu_0 N_0 + \frac32\mu_1 N_0 v$. A public model of an asRoBallet with 36 rollers needs 3.9,
5.5 and 8.3 N at 0.05, 0.2 and 0.5 m/s; the preset, with $\mu_0 = 0.008$ and $\mu_1 = 0.084$ s/m, has this drag.

Unlike the friction of the floor, roller friction acts between ball and body: it turns the body with the ball. The sweep
is over $\mu_0$.
"""

import math

import ballbot_rs as bb
from validation.claim import Claim
from validation.robots.energy import drag
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

SWEEP = Sweep(
    "friction coefficient of the rollers",
    (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2),
    lambda friction: drawn("roller_friction", "abs", friction),
    0.005,
    '--set \'events=[{"term": "roller_friction", "range": [0.005, 0.005]}]\'',
)
#: Drag of a public model of asRoBallet with 36 rollers, N, by its speed, m/s.
_PUBLIC = {0.05: 3.9, 0.2: 5.5, 0.5: 8.3}


def roller_drag(params: bb.Params, model: str, speed: float) -> float:
    """Drag of the upright robot towards its first wheel, N."""
    return drag(params, model, bb.State.rolling(params, (speed, 0.0)))


def closed_form(params: bb.Params, speed: float) -> float:
    """The same with the loads at rest, without friction of the joints, N."""
    load = (params.body_mass * params.gravity) / (3.0 * math.cos(params.wheel_zenith))
    return load * (2.0 * params.roller_friction + 1.5 * params.roller_friction_slope * speed)


def claims() -> list[Claim]:
    """Drag in both simulations, and of an asRoBallet."""
    rough = PAPER.replace(roller_friction=0.02, roller_friction_slope=0.1)
    expected = closed_form(rough, 0.2)
    found = [
        Claim(f"drag at 0.2 m/s, {model}", roller_drag(rough, model, 0.2), expected, 2e-3, "N")
        for model in ("contact", "rigid")
    ]
    asroballet = bb.Params.preset("asroballet").replace(roller_friction=0.008, roller_friction_slope=0.084)
    for speed, public in _PUBLIC.items():
        name = f"drag of asroballet at {speed:g} m/s, contact and public model"
        found.append(Claim(name, roller_drag(asroballet, "contact", speed), public, 0.02, "N"))
    return found


def run() -> Findings:
    """Sweeps the friction of the rollers."""
    robots = [PAPER.replace(roller_friction=friction) for friction in SWEEP.values]
    lines = [closed_form(params, 0.2) for params in robots]
    dots = [roller_drag(params, "contact", 0.2) for params in robots]
    return Measured(SWEEP).findings(claims(), "drag at 0.2 m/s (N)", lines, dots)
