r"""Stick and slip: the torque at which the wheels break loose, whatever the heading.

Three equal wheel torques turn the ball under the upright body; every load stays $N = M_b g/(3\cos\alpha)$. The
angular momenta of wheels, body and ball about the vertical give the traction of a wheel that grips, with
$s = \sin\alpha$ and $R = r_k + r_w$,

$$\frac f\tau = \frac{r_w/J_w + 3s^2R/J_z}{r_w^2/J_w + 3s^2 r_k^2/J_k + 3s^2R^2/J_z},$$

so that it breaks loose at $\tau = \mu N\ (f/\tau)^{-1}$. An engine with isotropic contact friction, or with a
friction pyramid that turns with the world, fails here: its limit depends on the heading. The limit is found by trying
torques; a wheel counts as slipping above 1 mm/s after 30 ms, which takes an excess of 0.05 %.
"""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.engines import probes
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MU = 0.3
_YAWS = np.radians(np.arange(0.0, 360.0, 15.0))
#: Relative limits of the torque's error, and of its spread over the headings.
_LIMITS = {"contact": (2e-3, 3e-6), "rigid": (2e-3, 3e-6)}


def run() -> Findings:
    """Finds the torque in each simulation at every heading."""
    params = bb.Params.paper().replace(wheel_static_friction=_MU, wheel_dynamic_friction=_MU)
    exact = slip_torque(params)
    claims, limits = [], {}
    for model, (limit, spread) in _LIMITS.items():
        found = [largest(partial(grips, params, model, yaw), 0.0, 1.0, to=1e-6) for yaw in _YAWS]
        limits[model] = np.array(found) / exact
        worst = float(limits[model][np.argmax(np.abs(limits[model] - 1.0))]) * exact
        claims += [
            Claim(
                f"torque where the wheels slip, worst heading, `{model}`",
                worst,
                exact,
                limit,
                "N·m",
            ),
            Claim(f"its spread over the headings, `{model}`", float(np.ptp(found)), 0.0, spread * exact, "N·m", True),
        ]

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import INK, MODEL_COLORS

        ax = fig.subplots(subplot_kw={"projection": "polar"})
        around = np.linspace(0.0, 2.0 * np.pi, 200)
        ax.plot(around, np.ones_like(around), color=INK, linewidth=4, alpha=0.25, label="closed form")
        for (model, share), marker in zip(limits.items(), ("o", "x"), strict=True):
            ax.plot(_YAWS, share, marker, color=MODEL_COLORS[model], label=model)
        ax.set(ylim=(0.0, 1.15), yticks=(0.5, 1.0))
        ax.set_title("torque at which the wheels slip over μN/(f/τ), by heading")
        ax.legend(loc="center")

    return Findings(claims, draw, size=(5.0, 4.2))


def slip_torque(params: bb.Params) -> float:
    """Torque, equal on all wheels, at which they break loose, N·m."""
    return params.wheel_static_friction * probes.resting_load(params) / traction_share(params)


def traction_share(params: bb.Params) -> float:
    """f/τ, 1/m."""
    p = params
    sines, reach = 3.0 * np.sin(p.wheel_zenith) ** 2, p.ball_radius + p.wheel_radius
    of_torque = p.wheel_radius / p.wheel_inertia + sines * reach / p.body_inertia[2]
    of_traction = (
        p.wheel_radius**2 / p.wheel_inertia
        + sines * p.ball_radius**2 / p.ball_inertia
        + sines * reach**2 / p.body_inertia[2]
    )
    return float(of_torque / of_traction)


def grips(params: bb.Params, model: str, yaw: float, torque: float) -> bool:
    """Whether no wheel slips 30 ms after three equal torques are applied."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.reset(bb.State.at_rest(robot.params, tilt=(0.0, 0.0), yaw=yaw))
    # The contacts of rapier take up their load first.
    robot.step(np.zeros(3), steps=20)
    robot.step(np.full(3, torque), steps=30)
    return float(np.abs(robot.contacts.wheel_slip_speeds).max()) < 1e-3
