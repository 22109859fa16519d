r"""The last stage: torques that the wheels can pass on.

The torques of a law go through one stage, the same for all of them
([`TorqueLimits`](../crates/ballbot-control/src/limits.rs)). Without slip the load $N_i$ of a wheel and its
traction $f_i$ are linear in the torques $\tau$, and nearly so in the tilt $\vartheta$ (heading frame), with a part
that is quadratic in the tilt rate $\Omega$:

```math
N = N^0 + N_\vartheta\vartheta + N_\tau\tau + N_\Omega\lvert\Omega\rvert^2, \qquad
 f = f^0 + f_\vartheta\vartheta + f_\tau\tau + f_\Omega\lvert\Omega\rvert^2 .
```

The constants are derivatives of the [contact forces](derivations.md#contact-loads-and-tractions) of the spatial model,
computed once a robot ([`LoadMap`](../crates/ballbot-models/src/load_map.rs)). No wheel slips or
lifts, and no motor gives more than it has, if for all wheels

```math
\pm f_i - \rho\mu N_i \le 0, \qquad \tfrac{3}{10} N_i^0 - N_i \le 0, \qquad \lvert\tau_i\rvert \le \tau_{\max},
```

with $\rho$ = `traction`, 0.9 by default. Each row is $c + g\cdot\tau \le 0$, so the largest share of a wanted torque
is $s = 1/\max(1, \max_j g_j\cdot\tau/(-c_j))$: no iteration. The wanted torque has two parts: the one that turns the
body about the vertical, and the rest. The rest gets the largest share $s$, then the yaw torque the largest share that
is left. A torque within all rows stays as it is, to the last bit.

The load floor matters: $\lvert f_i\rvert \le \mu N_i$ alone allows a torque that unloads the third wheel, and the bot
lifts off its ball. Where a wheel slips all the same (by more than 0.1 m/s, as after a push that lifts it), the maps do
not hold, and the torques are scaled down together to what grips upright. On estimates ([sensors](sensors.md)) the
speeds of the wheels come in steps of $2\pi r_w/(nT)$ for $n$ ticks a turn and control steps of $T$: where these are
above 0.1 m/s, as with 512 ticks at 500 Hz, a tick counts as slip, and the robot has the limits of the upright one.

The rows are those of the wheels; the floor counts as having grip. On a `Batch` the torque of an action is a limit,
too. By default it is 0.9 of what the upright robot's wheels carry, less than a robot that leans can use;
`max_wheel_torque=params.max_wheel_torque` leaves a controller its own limits, as `compare`, `evaluate` and this page
do.

**Clipped errors.** LQR's deviations of the position ask for a speed, those of position and velocity for a lean:
$\vartheta_r = -K_\vartheta^+ K_e e$, with the columns $K_\vartheta$ and $K_e$ of its gain. Both are cut as vectors, to
`max_speed` and `max_lean`. Without the cut the position takes the torque that the balance needs.

`traction=False` and large `max_lean` and `max_speed` turn both off. The tables have each robot's worst and mean over 24
directions: the tilt it recovers from, let go at rest, in steps of 0.5°; and the push at the center of mass that it
stands, in steps of 0.05 N·s, at once or along a half sine of 0.1 s. The bounds are those of a planar robot in the worst
direction: 29.7° is the largest tilt at which traction can turn the robot back, 2.41 N·s the largest push that does not
bring the capture point beyond what the upright robot's traction holds. Both may be passed: they have the dynamic
coefficient of friction, wheels that grip the static one, and leaning loads the wheels that pull.
"""

from functools import cache

import ballbot_rs as bb
from validation.claim import Claim
from validation.controllers.trials import Stood, measure, side_by_side
from validation.topic import Findings

#: Options that disable the clips.
_ANY = 1e3
VARIANTS = {
    "a largest torque alone": bb.Lqr(traction=False, max_lean=_ANY, max_speed=_ANY),
    "with clipped errors": bb.Lqr(traction=False),
    "traction scaling": bb.Lqr(max_lean=_ANY, max_speed=_ANY),
    "both (the default)": bb.Lqr(),
    "both, all of the friction limit": bb.Lqr(traction=1.0),
}
DEFAULT = "both (the default)"
#: Limits of the default in the worst direction: tilt, deg, and pushes, instantaneous and over 0.1 s, N·s.
BASIN, AT_ONCE, SLOW = 28.0, 2.15, 3.1


@cache
def measured(name: str) -> Stood:
    """Disturbance limits of a variant of LQR."""
    return measure(VARIANTS[name])


def run() -> Findings:
    """LQR with and without the stage and the clips."""
    return Findings(claims(), None, side_by_side("LQR", {name: measured(name) for name in VARIANTS}))


def claims() -> list[Claim]:
    """Claims on the worst directions with both."""
    tilt, at_once, slow = (of.min() for of in measured(DEFAULT))
    return [
        Claim("worst tilt, LQR with both", tilt, BASIN, 0.5, "deg", absolute=True),
        Claim("worst push at once, LQR with both", at_once, AT_ONCE, 0.1, "N·s", absolute=True),
        Claim("worst push in 0.1 s, LQR with both", slow, SLOW, 0.1, "N·s", absolute=True),
    ]
