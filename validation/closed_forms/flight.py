r"""Free fall, touchdown and rest.

Lifted by $h$ and released, the robot falls as $h - \tfrac12 g t^2$ and touches at $\sqrt{2h/g}$. A step moves by the
velocity at its end, so the fall runs ahead of the closed form by $\tfrac12 g t\ \Delta t$: 0.7 mm here, half a step in
time. No contact gives energy back: within a few steps the robot's momentum $M v$ is gone, and it stays. At any time
the floor must have given $\int F_z\ dt = M g t + p_z$, with $p_z$ the momentum of ball and bot. Over the whole run,
which ends at rest, that is $M g T$. In the first 10 ms on the floor it is $M v$ plus the impulse of the weight. The
small rise afterwards is not a bounce; it is the removal of overlap.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

import ballbot_rs as bb
from validation import momentum
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT, _DT, _STEPS = 0.1, 1e-3, 400
#: Duration of the landing, s, and the fraction of the momentum that is left at its end.
_LANDING, _LEFT = 0.01, 0.01
#: Of speed (m/s) and height (m) in the fall, impulses up to any time and over the run, impulse of the landing, its
#: length (s), and the ratio of the speed back up to the touchdown speed.
_LIMITS = {
    "contact": (5e-14, 5e-15, 1e-12, 1e-12, 1e-5, 0.003, 1e-4),
    "rigid": (5e-14, 5e-15, 1e-12, 1e-12, 1e-5, 0.003, 1e-4),
}


class Drop(NamedTuple):
    """After each step: height of the ball (m), its speed (m/s), force of the floor (N), momentum of ball and bot."""

    heights: Array
    speeds: Array
    forces: Array
    momenta: Array


def run() -> Findings:
    """Drops the upright robot in each simulation."""
    params = bb.Params.paper()
    mass, g = params.ball_mass + params.body_mass, params.gravity
    lands = np.sqrt(2.0 * _HEIGHT / g)
    times = np.arange(1, _STEPS + 1) * _DT
    exact = np.maximum(_HEIGHT - 0.5 * g * times**2, 0.0)
    claims, paths = [], {}
    for model, limits in _LIMITS.items():
        d = drop(params, model)
        paths[model] = d.heights
        falling = times < lands - _DT
        speed_error = float(np.abs(d.speeds + g * times)[falling].max())
        ahead = float(np.abs(d.heights - exact + 0.5 * g * times * _DT)[falling].max())
        touches = int(np.argmax(d.forces > 0.0))
        fast = mass * abs(float(d.speeds[touches - 1]))
        lacking = np.abs(np.cumsum(d.forces) * _DT - mass * g * times - d.momenta).max() / fast
        landed = touches + round(_LANDING / _DT)
        landing = float(np.sum(d.forces[touches:landed] - mass * g) * _DT)
        lasts = (int(np.argmax(np.abs(d.momenta[touches:]) < _LEFT * fast)) + 1) * _DT
        back = max(0.0, float(d.speeds.max())) * mass / fast
        claims += [
            Claim(f"speed in the fall against $gt$, worst, `{model}`", speed_error, 0.0, limits[0], "m/s", True),
            Claim(f"height against closed form and half a step, worst, `{model}`", ahead, 0.0, limits[1], "m", True),
            Claim(
                f"impulses of floor and weight less momentum, worst, over $Mv$, `{model}`",
                float(lacking),
                0.0,
                limits[2],
                absolute=True,
            ),
            Claim(
                f"impulse of the floor over the whole run, `{model}`",
                float(d.forces.sum() * _DT),
                mass * g * _STEPS * _DT,
                limits[3],
                "N·s",
            ),
            Claim(f"impulse of the landing less the weight's, `{model}`", landing, fast, limits[4], "N·s"),
            Claim(f"time until 1 % of the momentum is left, `{model}`", lasts, 0.0, limits[5], "s", True),
            Claim(f"largest rebound speed over the touchdown speed, `{model}`", back, 0.0, limits[6], "", True),
        ]

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS
        from ballbot_rs.media.figures.style import INK

        ax = fig.subplots()
        ax.plot(times, exact * 1e3, color=INK, linewidth=6, alpha=0.2, label="closed form")
        for model, heights in paths.items():
            ax.plot(times, heights * 1e3, label=model, **MODEL_LOOKS[model])
        ax.set(xlabel="time (s)", ylabel="height of the ball (mm)")
        ax.legend()

    return Findings(claims, draw, size=(6.0, 3.0))


def drop(params: bb.Params, model: str) -> Drop:
    """The fall and the rest after it."""
    robot = bb.Ballbot(params, model=model, sim_dt=_DT)
    lift, upright = np.array([0.0, 0.0, _HEIGHT]), bb.State.at_rest(params)
    robot.reset(upright.replace(ball_position=upright.ball_position + lift, body_position=upright.body_position + lift))
    rows = []
    for _ in range(_STEPS):
        robot.step(np.zeros(3))
        state = robot.state
        rows.append(
            [
                state.ball_position[2] - params.ball_radius,
                state.ball_velocity[2],
                robot.contacts.floor_force[2],
                momentum.linear(params, state)[2],
            ]
        )
    return Drop(*np.array(rows).T)
