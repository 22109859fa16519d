r"""Momentum with friction off.

On a floor without friction nothing outside the robot acts horizontally: its horizontal momentum, and its angular
momentum about the vertical, are constant while it topples and its motors turn ball and body against each other,
wheels slipping or not. `contact` keeps the horizontal momentum to rounding. `rigid` does not: that is a first-order
error of rapier's multibody step, not of the reading, since `contact` moves the same way. The angular momentum drifts in
both, to first order in the step; reading the attitude half a step back would take off two thirds of it in `contact`.
Errors of first order must halve with the step.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation import momentum
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SECONDS, _VELOCITY = 0.4, np.array([0.3, -0.2, 0.0])
_TORQUES = np.array([0.3, 0.1, 0.2])
_NAMES = ("horizontal momentum", "angular momentum about the vertical")
#: Limit of each drift relative to the momentum that ball and body exchange.
_LIMITS = {"contact": (3e-14, 3e-2), "rigid": (5e-3, 1e-2)}


def run() -> Findings:
    """Lets the robot topple on ice in each simulation."""
    claims, shown = [], {}
    for model, limits in _LIMITS.items():
        shown[model] = np.abs(topple(model, 1e-3))
        usual, finer = shown[model].max(axis=0), np.abs(topple(model, 5e-4)).max(axis=0)
        for name, drift, halved, limit in zip(_NAMES, usual, finer, limits, strict=True):
            claims.append(Claim(f"{name}, drift, `{model}`", drift, 0.0, limit, absolute=True))
            if drift > 1e-12:
                claims.append(Claim(f"the same at 2 kHz over that at 1 kHz, `{model}`", halved / drift, 0.5, 2e-2))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS

        for ax, column, name in zip(fig.subplots(1, 2), (0, 1), _NAMES, strict=True):
            for model, drifts in shown.items():
                times = np.arange(1, len(drifts) + 1) * 1e-3
                ax.semilogy(times, drifts[:, column] + 1e-18, label=model, **MODEL_LOOKS[model])
            ax.set(xlabel="time (s)", ylabel="drift over what is exchanged", title=name)
            ax.legend()

    return Findings(claims, draw)


def topple(model: str, sim_dt: float) -> Array:
    """Drifts of both after each step (steps, 2), relative to the momenta that ball and body exchange."""
    params = bb.Params.paper().replace(floor_static_friction=0.0, floor_dynamic_friction=0.0)
    robot = bb.Ballbot(params, model=model, sim_dt=sim_dt)
    start = bb.State.at_rest(params, tilt=(0.2, -0.1), yaw=0.4)
    robot.reset(start.replace(ball_velocity=_VELOCITY, body_velocity=_VELOCITY))
    first = robot.state
    linear, angular = momentum.linear(params, first)[:2], momentum.about_vertical(params, first)
    drifts, exchanged = [], []
    for _ in range(round(_SECONDS / sim_dt)):
        robot.step(_TORQUES)
        state = robot.state
        drifts.append(
            [
                float(np.linalg.norm(momentum.linear(params, state)[:2] - linear)),
                momentum.about_vertical(params, state) - angular,
            ]
        )
        ball = params.ball_mass * (state.ball_velocity - _VELOCITY)[:2]
        exchanged.append([float(np.linalg.norm(ball)), params.ball_inertia * abs(state.ball_angular_velocity[2])])
    return np.asarray(np.array(drifts) / np.max(exchanged, axis=0))
