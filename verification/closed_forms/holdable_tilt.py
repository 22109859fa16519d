r"""The largest tilt that the wheels' friction lets the robot hold.

A robot that keeps its tilt $\theta$ accelerates with the $a$ of the topic before. Its wheels must pass the tractions
$f_i = (\tau_i - J_w\dot\sigma_i)/r_w$ with $\dot\sigma_i = k\ u_i\cdot R^\top\dot\omega_k$ under the loads that carry
the body,

$$\sum_i N_i p_i - \sum_i f_i d_i = R^\top M_b\ (\mathbf a + g\ e_3),$$

three equations for three loads. The largest tilt is where the first $|f_i|$ reaches $\mu N_i$; the worst azimuth
counts. The paper speaks of 30° (section III-A): that is a wheel friction of 1.
"""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from peers.rotations import matrix
from verification.claim import Claim
from verification.robots import leaning, steady_lean, wheel_directions
from verification.search import largest
from verification.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Wheel friction and the tilt (deg) that an independent computation found for it.
_KNOWN = {0.5: 17.3, 0.6: 20.2, 0.8: 25.5, 1.0: 29.8, 1.1: 31.7}
_AZIMUTHS = np.radians(np.arange(0.0, 120.0, 2.5))
_LIMITS = {"contact": 2e-3, "rigid": 5e-3}


def run() -> Findings:
    """Finds the largest tilt from the formula, and by trying in each simulation."""
    claims: list[Claim] = []
    curves: dict[str, list[float]] = {"formula": [], **{model: [] for model in _LIMITS}}
    for mu, known in _KNOWN.items():
        params = bb.Params.paper().replace(
            wheel_static_friction=mu, wheel_dynamic_friction=mu, floor_static_friction=5.0, floor_dynamic_friction=5.0
        )
        tilt = largest(partial(grips, params), 0.0, 0.8)
        worst = float(max(_AZIMUTHS, key=partial(needed_friction, params, tilt)))
        exact = float(np.degrees(tilt))
        curves["formula"].append(exact)
        claims.append(Claim(f"formula, μ = {mu}", exact, known, 1e-2, "deg"))
        for model, limit in _LIMITS.items():
            found = largest(partial(holds, params, model, worst), 0.1, 0.8, to=1e-4)
            curves[model].append(float(np.degrees(found)))
            claims.append(Claim(f"`{model}`, μ = {mu}", float(np.degrees(found)), exact, limit, "deg"))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import INK, MODEL_COLOURS

        ax = fig.subplots()
        ax.plot(list(_KNOWN), curves["formula"], color=INK, linewidth=4, alpha=0.25, label="closed form")
        for model, marker in zip(_LIMITS, ("o", "x"), strict=True):
            ax.plot(list(_KNOWN), curves[model], marker, color=MODEL_COLOURS[model], label=f"{model}, tried")
        ax.axhline(30.0, color=INK, linewidth=0.8, linestyle=":")
        ax.annotate("the paper's 30°", (0.5, 30.0), xytext=(0, 4), textcoords="offset points")
        ax.set(xlabel="friction coefficient of wheel on ball", ylabel="largest tilt that is held (deg)")
        ax.legend(loc="lower right")

    return Findings(claims, draw, size=(6.0, 3.2))


def grips(params: bb.Params, tilt: float) -> bool:
    """Whether no wheel needs more friction than there is, whatever the azimuth."""
    return max(needed_friction(params, tilt, azimuth) for azimuth in _AZIMUTHS) <= params.wheel_dynamic_friction


def needed_friction(params: bb.Params, tilt: float, azimuth: float) -> float:
    """Largest traction over load of a wheel while the tilt is held; infinite if a wheel would have to pull."""
    p = params
    acceleration, torque = steady_lean(p, tilt)
    state, torques = leaning(p, tilt, azimuth, 0.0, torque)
    rotation = matrix(state.body_quaternion)
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    rolling = np.array([-along[1], along[0], 0.0]) * acceleration / p.ball_radius
    spin_up = p.ball_radius / p.wheel_radius * wheel_directions(p) @ (rotation.T @ rolling)
    tractions = (torques - p.wheel_inertia * spin_up) / p.wheel_radius
    betas = np.array(p.wheel_azimuths)
    sin, cos = np.sin(p.wheel_zenith), np.cos(p.wheel_zenith)
    contacts = np.array([sin * np.cos(betas), sin * np.sin(betas), np.full(3, cos)])
    drives = np.array([-np.sin(betas), np.cos(betas), np.zeros(3)])
    carried = rotation.T @ (p.body_mass * (acceleration * along + [0.0, 0.0, p.gravity]))
    loads = np.linalg.solve(contacts, carried + drives @ tractions)
    return float(np.max(np.abs(tractions) / loads)) if np.all(loads > 0.0) else np.inf


def holds(params: bb.Params, model: str, azimuth: float, tilt: float) -> bool:
    """Whether no wheel slips 40 ms after the robot was let go under the torques that hold the tilt."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    _, torque = steady_lean(params, tilt)
    state, torques = leaning(params, tilt, azimuth, 0.0, torque)
    robot.reset(state)
    robot.step(torques, steps=40)
    return float(np.abs(robot.contacts.wheel_slip_speeds).max()) < 1e-3
