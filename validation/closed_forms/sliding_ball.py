r"""A ball that is thrown along the floor: it slides, then rolls.

The bot hangs 15 m up in free fall, so only the floor acts on the ball. It starts at $v_0$ without spin. Coulomb
friction slows it and spins it up, $v = v_0 - \mu g t$ and $\omega r_k = \mu g t\ M_k r_k^2 / J_k$, until it rolls at

$$t_r = \frac{v_0}{\mu g\ (1 + M_k r_k^2/J_k)}, \qquad v_r = \frac{v_0}{1 + J_k/(M_k r_k^2)},$$

which is 5/7 of $v_0$ for a homogeneous ball and 0.6167 $v_0$ for the ball of Table II. From there it keeps its speed.
Whatever the direction, friction is $\mu$ times the load.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MU, _SPEED, _SECONDS = 0.2, 2.0, 0.6
_HEIGHT = 15.0
#: Error limits: of the speed when it rolls, relative; of the speed at any time, m/s.
_LIMITS = {"contact": (1e-12, 1e-12), "rigid": (1e-9, 5e-9)}


def run() -> Findings:
    """Throws the ball in each model; the heading of the throw varies, the result must not."""
    params = bb.Params.paper().replace(floor_static_friction=_MU, floor_dynamic_friction=_MU)
    inertia = params.ball_inertia / (params.ball_mass * params.ball_radius**2)
    rolls_at = _SPEED / (_MU * params.gravity * (1.0 + 1.0 / inertia))
    rolls_with = _SPEED / (1.0 + inertia)
    times = np.arange(0.0, _SECONDS, 1e-3) + 1e-3
    exact = np.where(times < rolls_at, _SPEED - _MU * params.gravity * times, rolls_with)
    claims, speeds = [], {}
    for model, (limit, any_time) in _LIMITS.items():
        speeds[model], frictions = throw(params, model, 0.4, len(times))
        sliding = times < 0.9 * rolls_at
        worst = float(np.abs(speeds[model] - exact).max())
        claims += [
            Claim(f"speed when it rolls, `{model}`", speeds[model][-1], rolls_with, limit, "m/s"),
            Claim(
                f"worst difference of speed over {_SECONDS} s, `{model}`", worst, 0.0, any_time, "m/s", absolute=True
            ),
            Claim(f"friction over load while sliding, `{model}`", float(frictions[sliding].mean()), _MU, 1e-13),
        ]
        limits = [throw(params, model, angle, 50)[1][-1] for angle in np.arange(24) * np.pi / 12.0]
        spread = float(np.ptp(limits))
        claims.append(Claim(f"spread of it over 24 directions, `{model}`", spread, 0.0, 1e-14, "", absolute=True))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS
        from ballbot_rs.media.figures.style import INK

        left, right = fig.subplots(1, 2)
        left.plot(times, exact, color=INK, linewidth=6, alpha=0.2, label="closed form")
        for model, speed in speeds.items():
            left.plot(times, speed, label=model, **MODEL_LOOKS[model])
            right.semilogy(times, np.abs(speed - exact) + 1e-16, label=model, **MODEL_LOOKS[model])
        left.axvline(rolls_at, color=INK, linewidth=0.8, linestyle=":", label="rolls from here")
        left.set(xlabel="time (s)", ylabel="speed of the ball (m/s)")
        right.set(xlabel="time (s)", ylabel="difference from the closed form (m/s)")
        left.legend()

    return Findings(claims, draw)


def throw(params: bb.Params, model: str, direction: float, steps: int) -> tuple[Array, Array]:
    """Speeds of the ball and friction over load after each of `steps` steps of 1 ms."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    upright = bb.State.at_rest(params)
    robot.reset(
        upright.replace(
            ball_velocity=_SPEED * np.array([np.cos(direction), np.sin(direction), 0.0]),
            body_position=upright.body_position + np.array([0.0, 0.0, _HEIGHT]),
            body_velocity=np.zeros(3),
        )
    )
    speeds, frictions = [], []
    for _ in range(steps):
        robot.step(np.zeros(3))
        speeds.append(float(np.linalg.norm(robot.state.ball_velocity)))
        force = robot.contacts.floor_force
        frictions.append(float(np.hypot(force[0], force[1]) / force[2]) if force[2] > 0.0 else np.nan)
    return np.array(speeds), np.array(frictions)
