r"""The last stage: torques that the wheels can transmit.

The torques of every controller but `nmpc` pass through the same last stage
([`TorqueLimits`](../crates/ballbot-control/src/parts/limits.rs)). Without slip the load $N_i$ of a wheel and its
traction $f_i$ are linear in the torques $\tau$, and nearly linear in the tilt $\vartheta$ (heading frame), with a part
that is quadratic in the tilt rate $\Omega$:

```math
N = N^0 + N_\vartheta\vartheta + N_\tau\tau + N_\Omega\lvert\Omega\rvert^2, \qquad
 f = f^0 + f_\vartheta\vartheta + f_\tau\tau + f_\Omega\lvert\Omega\rvert^2 .
```

The constants are derivatives of the [contact forces](derivations.md#contact-loads-and-tractions) of the spatial model,
computed once per robot ([`LoadMap`](../crates/ballbot-models/src/load_map.rs)). No wheel slips or
lifts, and no motor exceeds its torque limit, if for all wheels

```math
\pm f_i - \rho\mu N_i \le 0, \qquad \tfrac{3}{10} N_i^0 - N_i \le 0, \qquad \lvert\tau_i\rvert \le \tau_{\max},
```

with $\rho$ = `traction`, 0.9 by default. Each row is $c + g\cdot\tau \le 0$, so the largest feasible fraction of a
commanded torque is $s = 1/\max(1, \max_j g_j\cdot\tau/(-c_j))$, without iteration. The commanded torque has two parts:
the yaw torque, which turns the body about the vertical, and the rest. The rest is scaled first, by its largest $s$;
then the yaw torque, by the largest fraction that is still feasible. A torque that satisfies all rows is passed through
unchanged, to the last bit.

The load floor matters: $\lvert f_i\rvert \le \mu N_i$ by itself allows a torque that unloads the third wheel, and the
bot lifts off its ball. Where a wheel slips nevertheless (by more than 0.1 m/s, for example after a push that lifts it),
the maps do not hold. All torques are then scaled down together to the friction limit of the upright robot, and a torque
that drives its wheel into slip is reduced further, to zero at most, by

```math
\frac{J_w}{r_w\,\max(T, 0.06\ \mathrm{s})}\,\lvert v_i\rvert
```

with the inertia $J_w$ of wheel and rotor, the slip speed $v_i$ and control steps of $T$. At its full torque a wheel
whose load has dropped spins up until the robot falls: without this reduction, `lqr` lost rezero in some directions
after impulsive pushes of a tenth of what it withstands now. On estimates ([sensors](sensors.md)) the wheel speeds are
quantized in steps of $2\pi r_w/(nT)$ for $n$ ticks per turn: where such a step is above 0.1 m/s, as with 512 ticks at
500 Hz, one tick counts as slip, and lowers torques.

Two options of every controller limit the motion: `speed_limit` and `boundary`. A control barrier function ahead of this
stage enforces them: [limits of the motion](safety.md#limits-of-the-motion).

Friction in the wheel joints does not reach the ball. All laws are designed for the robot without it, and a compensation
torque is added at the very end, within the torque limit, from the current speed $\omega_i$ of each wheel:

```math
b\,\omega_i + c\,\frac{\omega_i}{\sqrt{\omega_i^2 + \omega_0^2}},
```

with `wheel_viscous_friction` $b$, `wheel_coulomb_friction` $c$ and $\omega_0$ = 1 rad/s. At rest, where dry friction
acts in either direction, nothing is added.

The rows limit the wheels only; the ball is assumed to grip the floor. On a `Batch` the largest torque of an action is a
limit, too. By default it is 0.9 of what the wheels of the upright robot transmit, less than a leaning robot can use.
`max_wheel_torque=params.max_wheel_torque` leaves only the controller's limits; `compare`, `evaluate` and this page use
it.

**Clipped errors.** In LQR, a position error commands a speed, and position and velocity errors command a lean:
$\vartheta_r = -K_\vartheta^+ K_e e$, with the columns $K_\vartheta$ and $K_e$ of its gain. Both are clipped as vectors,
to `max_speed` and `max_lean`. Without the clips the position error uses up the torque that balancing needs.

`traction=False` turns off the traction scaling, large `max_lean` and `max_speed` the clipping. The tables have the
worst case and the mean over 24 directions of two disturbance limits: the largest tilt from which the robot recovers,
released at rest, in steps of 0.5°; and the largest push at the center of mass, in steps of 0.05 N·s, applied
instantaneously or as a half sine of 0.1 s. Bounds of a planar robot in the worst direction: 29.7° is the largest tilt
at which traction can turn the robot back, 2.41 N·s the largest push that does not move the capture point beyond what
the upright robot's traction can hold. Measured limits may exceed both: the bounds use the dynamic coefficient of
friction, while wheels that grip have the static coefficient, and leaning loads the wheels that pull.
"""

from functools import cache

import ballbot_rs as bb
from validation.claim import Claim
from validation.controllers.trials import Stood, measure, side_by_side
from validation.topic import Findings

#: Options that disable the clips.
_ANY = 1e3
VARIANTS = {
    "only a torque limit": bb.Lqr(traction=False, max_lean=_ANY, max_speed=_ANY),
    "with clipped errors": bb.Lqr(traction=False),
    "traction scaling": bb.Lqr(max_lean=_ANY, max_speed=_ANY),
    "both (the default)": bb.Lqr(),
    "both, all of the friction limit": bb.Lqr(traction=1.0),
}
DEFAULT = "both (the default)"
#: Limits of the default in the worst direction: tilt, deg, and pushes, instantaneous and over 0.1 s, N·s.
BASIN, AT_ONCE, SLOW = 28.0, 2.25, 3.1


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
