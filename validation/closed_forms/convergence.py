r"""Order of convergence with the time step.

There is no closed form of this motion: the reference is the same motion at a much finer step. So this section shows how
fast each model approaches its limit; the other sections show that the limits are right.

From a tilted start the robot topples for 0.4 s under constant torques, with no slip. The error is the distance between
the masts' tips at unit length, plus the distance between the balls in radii, from the reference at 0.1 ms: `planar` for
`planar`, `spatial` for all others. The classical Runge-Kutta method of `planar` and `spatial` is of order 4, the
semi-implicit Euler method of `contact` and `rigid` of order 1.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.engines.rotations import matrix
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SECONDS = 0.4
_TORQUES = np.array([0.02, 0.005, 0.01])
_RUNGE_KUTTA = np.array([0.02, 0.01, 0.005, 0.0025])
_EULER = np.array([4e-3, 2e-3, 1e-3, 5e-4])
#: Steps, order, and how far from it the slope may be.
_ORDERS = {
    "planar": (_RUNGE_KUTTA, 4.0, 0.2),
    "spatial": (_RUNGE_KUTTA, 4.0, 0.2),
    "contact": (_EULER, 1.0, 0.01),
    "rigid": (_EULER, 1.0, 0.05),
}
_TICKS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
_LINES = {"planar": "s-", "spatial": "o--", "contact": "s-", "rigid": "o--"}


def run() -> Findings:
    """Fits the slope of error over time step, both in logarithms."""
    claims, errors = [], {}
    for model, (steps, order, off) in _ORDERS.items():
        exact = end("planar" if model == "planar" else "spatial", 1e-4)
        errors[model] = np.array([np.linalg.norm(end(model, dt) - exact) for dt in steps])
        slope = float(np.polyfit(np.log(steps), np.log(errors[model]), 1)[0])
        claims.append(Claim(f"order, `{model}`", slope, order, off, absolute=True))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import MODEL_COLORS

        ax = fig.subplots()
        for model, (steps, order, _) in _ORDERS.items():
            color = MODEL_COLORS[model]
            ax.loglog(steps * 1e3, errors[model], _LINES[model], color=color, label=f"{model} (order {order:.0f})")
            ax.loglog(steps * 1e3, errors[model][0] * (steps / steps[0]) ** order, ":", color=color)
        ax.set(xlabel="time step (ms)", ylabel="error of the state after 0.4 s (SI units)")
        ax.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS], minor=False)
        ax.set_xticks([], minor=True)
        ax.legend()

    return Findings(claims, draw, size=(6.0, 3.4))


def end(model: str, sim_dt: float) -> Array:
    """Ball position in radii and direction of the mast after the fall."""
    robot = bb.Ballbot(model=model, sim_dt=sim_dt)
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.05, -0.03)))
    robot.step(_TORQUES, steps=round(_SECONDS / sim_dt))
    state = robot.state
    mast = matrix(state.body_quaternion)[:, 2]
    return np.concatenate([state.ball_position[:2] / robot.params.ball_radius, mast])
