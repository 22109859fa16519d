r"""The largest tilt that the wheels' friction lets the robot hold.

A robot that keeps its tilt $\theta$ accelerates with the $a$ of the topic before. With
$M_\ast = M_k + M_b + J_k/r_k^2$ and azimuths $\beta_i$ counted from the axis about which it leans, Euler's equation of
the ball and the balance of the bot's forces give its wheels the tractions and loads

$$f_i = \frac{2 M_\ast a}{3\cos\alpha}\cos\beta_i,\qquad N_i = \frac{M_b(g\cos\theta + a\sin\theta)}{3\cos\alpha}
+ \frac{2\sin\beta_i}{3\sin\alpha}\Bigl(M_b(a\cos\theta - g\sin\theta) + \frac{M_\ast a}{\cos\alpha}\Bigr).$$

The largest tilt is where the first $|f_i|$ reaches $\mu N_i$; the worst azimuth counts. The closed form is compared
with another way to the same forces: torques by virtual work, $f_i = (\tau_i - J_w\dot\sigma_i)/r_w$ with
$\dot\sigma_i = k\ u_i\cdot R^\top\dot\omega_k$, and the loads from
$\sum_i N_i p_i - \sum_i f_i d_i = R^\top M_b\ (\mathbf a + g\ e_3)$, three equations. And it is compared with trying,
in the simulations at the worst azimuth: with the torques that hold the tilt, no wheel slips by 1 mm/s within 40 ms.
"""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from validation.claim import Claim
from validation.engines.rotations import matrix
from validation.mechanics import Array, leaning, steady_lean, wheel_directions
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Tractions and loads of a robot, from its tilt and azimuth.
Forces = Callable[[bb.Params, float, float], tuple[Array, Array]]

#: Friction coefficients of wheel on ball.
FRICTIONS = (0.5, 0.6, 0.8, 1.0, 1.1)
#: Azimuths of the lean; the wheels repeat after 120 deg.
AZIMUTHS = np.radians(np.arange(0.0, 120.0, 2.5))
_LIMITS = {"contact": 1e-3, "rigid": 3e-3}


def run() -> Findings:
    """Finds the largest tilt from the formula, and by trying in each simulation."""
    claims = [
        Claim(
            "difference of forces, closed form and balance, over the load at rest",
            _apart(bb.Params.paper()),
            0.0,
            1e-14,
            absolute=True,
        )
    ]
    curves: dict[str, list[float]] = {"formula": [], **{model: [] for model in _LIMITS}}
    for mu in FRICTIONS:
        params = robot(mu)
        tilts = largest_tilts(params)
        worst, exact = float(AZIMUTHS[tilts.argmin()]), float(np.degrees(tilts.min()))
        by_balance = float(np.degrees(_largest(params, worst, balance)))
        curves["formula"].append(exact)
        claims.append(Claim(f"balance of forces, μ = {mu}", by_balance, exact, 1e-9, "deg"))
        for model, limit in _LIMITS.items():
            found = largest(partial(holds, params, model, worst), 0.1, 0.8, to=1e-4)
            curves[model].append(float(np.degrees(found)))
            claims.append(Claim(f"`{model}`, μ = {mu}", float(np.degrees(found)), exact, limit, "deg"))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import INK, MODEL_COLORS

        ax = fig.subplots()
        ax.plot(FRICTIONS, curves["formula"], color=INK, linewidth=4, alpha=0.25, label="closed form")
        for model, marker in zip(_LIMITS, ("o", "x"), strict=True):
            ax.plot(FRICTIONS, curves[model], marker, color=MODEL_COLORS[model], label=f"{model}, tried")
        ax.axhline(30.0, color=INK, linewidth=0.8, linestyle=":")
        ax.annotate("the paper's 30°", (0.5, 30.0), xytext=(0, 4), textcoords="offset points")
        ax.set(xlabel="friction coefficient of wheel on ball", ylabel="largest tilt that is held (deg)")
        ax.legend(loc="lower right")

    return Findings(claims, draw, size=(6.0, 3.2))


def robot(friction: float) -> bb.Params:
    """The robot of Table II with this wheel friction, on a floor with enough friction."""
    return bb.Params.paper().replace(
        wheel_static_friction=friction,
        wheel_dynamic_friction=friction,
        floor_static_friction=5.0,
        floor_dynamic_friction=5.0,
    )


def closed_form(params: bb.Params, tilt: float, azimuth: float) -> tuple[Array, Array]:
    """Tractions and loads of a robot that keeps a tilt towards `azimuth` at yaw 0, N."""
    p, alpha = params, params.wheel_zenith
    a, _ = steady_lean(p, tilt)
    # The direction of the lean is 90 deg from its axis.
    betas = np.array(p.wheel_azimuths) - azimuth + 0.5 * np.pi
    moved = (p.ball_mass + p.body_mass + p.ball_inertia / p.ball_radius**2) * a
    shared = p.body_mass * (p.gravity * np.cos(tilt) + a * np.sin(tilt)) / (3.0 * np.cos(alpha))
    shifted = p.body_mass * (a * np.cos(tilt) - p.gravity * np.sin(tilt)) + moved / np.cos(alpha)
    tractions = 2.0 * moved / (3.0 * np.cos(alpha)) * np.cos(betas)
    return tractions, shared + 2.0 * np.sin(betas) / (3.0 * np.sin(alpha)) * shifted


def balance(params: bb.Params, tilt: float, azimuth: float) -> tuple[Array, Array]:
    """The same from the torques, the wheels' own inertia, and the bot's force balance."""
    p, geometry = params, robot_geometry(params)
    acceleration, torque = steady_lean(p, tilt)
    state, torques = leaning(p, tilt, azimuth, 0.0, torque)
    rotation = matrix(state.body_quaternion)
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    rolling = np.array([-along[1], along[0], 0.0]) * acceleration / p.ball_radius
    spin_up = p.ball_radius / p.wheel_radius * wheel_directions(p) @ (rotation.T @ rolling)
    tractions = (torques - p.wheel_inertia * spin_up) / p.wheel_radius
    carried = rotation.T @ (p.body_mass * (acceleration * along + [0.0, 0.0, p.gravity]))
    return tractions, np.linalg.solve(geometry.contacts.T, carried + geometry.drives.T @ tractions)


def _apart(params: bb.Params) -> float:
    pairs = [
        (np.concatenate(closed_form(params, tilt, azimuth)), np.concatenate(balance(params, tilt, azimuth)))
        for tilt in np.radians(np.arange(0.0, 45.0, 5.0))
        for azimuth in AZIMUTHS
    ]
    at_rest = closed_form(params, 0.0, 0.0)[1][0]
    return max(float(np.abs(a - b).max()) for a, b in pairs) / float(at_rest)


def largest_tilts(params: bb.Params) -> Array:
    """Largest tilt that can be held towards each azimuth, rad."""
    return np.array([_largest(params, float(azimuth), closed_form) for azimuth in AZIMUTHS])


def _largest(params: bb.Params, azimuth: float, forces: Forces) -> float:
    def grips(tilt: float) -> bool:
        tractions, loads = forces(params, tilt, azimuth)
        return bool(np.all(np.abs(tractions) <= params.wheel_dynamic_friction * loads))

    return largest(grips, 0.0, 1.4, to=1e-11)


def holds(params: bb.Params, model: str, azimuth: float, tilt: float) -> bool:
    """Whether no wheel slips 40 ms after the robot is released under the torques that hold the tilt."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    _, torque = steady_lean(params, tilt)
    state, torques = leaning(params, tilt, azimuth, 0.0, torque)
    robot.reset(state)
    robot.step(torques, steps=40)
    return float(np.abs(robot.contacts.wheel_slip_speeds).max()) < 1e-3
