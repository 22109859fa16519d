r"""A ball that rolls under a constant torque, the mast held at a constant tilt.

Leaning at $\theta$ towards the direction of travel without turning, the robot accelerates forever. Eliminating the
torque from the equations of ball and body,

$$a = \frac{M_b g l \sin\theta}{M_b l\cos\theta + (M_k + M_b) r_k + J_k/r_k - \bar J_w/r_w}, \qquad
\tau = r_w\Bigl(M_k + M_b + \frac{J_k}{r_k^2} + \frac{\bar J_w}{r_w^2}\Bigr) a,$$

with $\bar J_w = \tfrac32\cos^2\alpha\ J_w$ and $\tau$ the virtual torque. The term $\bar J_w/r_w$ is the angular
momentum that the wheels take up as they spin; the paper's planar model counts their spin relative to the body and has
no such term. Nothing controls the robot: only the torque holds the (unstable) balance, so that $v = a t$ is a test
of everything at once.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array, leaning, steady_lean
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TILT = np.radians(5.0)
_LIMITS = {"planar": 1e-12, "spatial": 1e-12, "contact": 2e-6, "rigid": 1e-7}
_STEPS = 500


def run() -> Findings:
    """Lets each model run from rest under the torque that holds its tilt."""
    params = bb.Params.paper()
    times = np.arange(1, _STEPS + 1) * 1e-3
    claims, off = [], {}
    for model, limit in _LIMITS.items():
        acceleration, torque = steady_lean(params, _TILT, absolute_wheel_spin=model != "planar")
        exact = acceleration * times
        speed, tilt = roll(params, model, torque)
        off[model] = (np.abs(speed / exact - 1.0), np.degrees(np.abs(tilt - _TILT)))
        claims += [
            Claim(f"speed after {times[-1]:.1f} s, `{model}`", float(speed[-1]), float(exact[-1]), limit, "m/s"),
            Claim(f"tilt then, `{model}`", float(np.degrees(tilt[-1])), float(np.degrees(_TILT)), limit, "deg"),
        ]

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS

        axes = fig.subplots(1, 2)
        for model, quantities in off.items():
            for ax, quantity in zip(axes, quantities, strict=True):
                ax.semilogy(times, quantity + 1e-16, label=model, **MODEL_LOOKS[model])
        axes[0].set(xlabel="time (s)", ylabel="relative error of the speed")
        axes[1].set(xlabel="time (s)", ylabel="difference of the tilt (deg)")
        axes[0].legend()

    return Findings(claims, draw)


def roll(params: bb.Params, model: str, torque: float) -> tuple[Array, Array]:
    """Speeds (m/s) and tilts after each step of 1 ms."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    # The planar model has its planes along x and y.
    azimuth, yaw = (0.0, 0.0) if model == "planar" else (0.7, 0.3)
    state, torques = leaning(params, _TILT, azimuth, yaw, torque)
    robot.reset(state)
    states = []
    for _ in range(_STEPS):
        robot.step(torques)
        states.append(robot.state)
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.array([s.ball_velocity[:2] @ along for s in states]), np.array([s.tilt for s in states])
