r"""Free fall, touchdown and rest.

Lifted by $h$ and let go, the robot falls as $h - \tfrac12 g t^2$, touches at $\sqrt{2h/g}$ and, since no contact
gives energy back, stays. Until it rests, the floor must have taken its momentum:
$\int (F_z - M g)\ dt = M\sqrt{2gh}$, and the energy that is gone is $M g h$. A step moves by the velocity at its end,
so the fall runs ahead of the closed form by $\tfrac12 g t\ \Delta t$: 0.7 mm here, half a step in time.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.robots import Array
from verification.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT, _DT, _STEPS = 0.1, 1e-3, 400
_MODELS = ("contact", "rigid")


def run() -> Findings:
    """Drops the upright robot in each simulation."""
    params = bb.Params.paper()
    mass, g = params.ball_mass + params.body_mass, params.gravity
    lands = np.sqrt(2.0 * _HEIGHT / g)
    times = np.arange(1, _STEPS + 1) * _DT
    exact = np.maximum(_HEIGHT - 0.5 * g * times**2, 0.0)
    claims, paths = [], {}
    for model in _MODELS:
        heights, speeds, forces, lost = drop(params, model)
        paths[model] = heights
        falling = times < lands - _DT
        speed_error = float(np.abs(speeds + g * times)[falling].max())
        ahead = float(np.abs(heights - exact + 0.5 * g * times * _DT)[falling].max())
        impulse = float(np.sum(forces - mass * g * (times > lands)) * _DT)
        claims += [
            Claim(f"speed in the fall against $gt$, worst, `{model}`", speed_error, 0.0, 1e-9, "m/s", absolute=True),
            Claim(
                f"height against closed form and half a step, worst, `{model}`", ahead, 0.0, 1e-9, "m", absolute=True
            ),
            Claim(f"impulse of the floor, `{model}`", impulse, mass * np.sqrt(2.0 * g * _HEIGHT), 1e-2, "N·s"),
            Claim(f"energy lost until it stands, `{model}`", lost, mass * g * _HEIGHT, 1e-3, "J"),
            Claim(f"height at the end, `{model}`", float(heights[-1]), 0.0, 1e-4, "m", absolute=True),
        ]

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import INK, MODEL_COLOURS

        ax = fig.subplots()
        ax.plot(times, exact * 1e3, color=INK, linewidth=4, alpha=0.25, label="closed form")
        for (model, heights), dashes in zip(paths.items(), ("-", "--"), strict=True):
            ax.plot(times, heights * 1e3, dashes, color=MODEL_COLOURS[model], label=model)
        ax.set(xlabel="time (s)", ylabel="height of the ball (mm)")
        ax.legend()

    return Findings(claims, draw, size=(6.0, 3.0))


def drop(params: bb.Params, model: str) -> tuple[Array, Array, Array, float]:
    """Heights (m), vertical speeds (m/s) and floor forces (N) after each step, and the energy lost (J)."""
    robot = bb.Ballbot(params, model=model, sim_dt=_DT)
    lift, upright = np.array([0.0, 0.0, _HEIGHT]), bb.State.upright(params)
    robot.reset(upright.replace(ball_position=upright.ball_position + lift, body_position=upright.body_position + lift))
    before, rows = robot.energy, []
    for _ in range(_STEPS):
        robot.step(np.zeros(3))
        state = robot.state
        rows.append(
            [state.ball_position[2] - params.ball_radius, state.ball_velocity[2], robot.contacts.floor_force[2]]
        )
    heights, speeds, forces = np.array(rows).T
    return heights, speeds, forces, before - robot.energy
