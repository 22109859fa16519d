r"""Eq. (8): wheel torques.

Eq. (8) takes virtual torques to wheel torques by the inverse of a matrix $A$,
$[\tau_1\ \tau_2\ \tau_3]^T = A^{-1}[\tau_x\ \tau_y\ \tau_z]^T$. With the rates $\dot\psi$ of the wheels and the rates
of the virtual wheels, which the input vector of eq. (6) gives as $\dot y_k/r_w - (r_k/r_w)\ \dot\theta_x$ and so on,
virtual work requires $\sum\tau_i\dot\psi_i$ to be the power of the virtual torques: the map of torques is the
transposed inverse of the map of rates. The printed $A^{-1}$ is a map of rates, wheel speeds from the ball's rates
relative to the body; used for torques it makes tilt torques $\tfrac{3}{2}\ (r_k/r_w)\cos^2\alpha = 1.68$ times and the
yaw torque $3\ (r_k/r_w)\sin^2\alpha = 3.36$ times too large. No zenith angle makes both 1. `virtual_to_wheel_torques`
has both maps.

Found are powers: the encoder rates of a moving robot (`SpatialModel.wheel_speeds`) times the wheel torques, over the
virtual torque times the rate of its virtual wheel.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def run() -> Findings:
    """Powers of both maps, and eq. (8) written out."""
    params = bb.Params.paper()
    ratios = {mapping: power_ratios(params, mapping) for mapping in ("as_printed", "consistent")}
    ratio = params.ball_radius / params.wheel_radius
    sine, cosine = np.sin(params.wheel_zenith), np.cos(params.wheel_zenith)
    closed = [1.5 * ratio * cosine**2, 1.5 * ratio * cosine**2, 3.0 * ratio * sine**2]
    printed = np.linalg.inv(eq_8(params))
    ours = np.array([bb.virtual_to_wheel_torques(params, unit, "as_printed") for unit in np.eye(3)]).T
    claims = [Claim("`as_printed` and eq. (8), largest difference", _largest(ours - printed), 0.0, 1e-14, "", True)]
    for i, name in enumerate(("τ_x", "τ_y", "τ_z")):
        claims.append(Claim(f"power of {name}, `as_printed`", ratios["as_printed"][i], closed[i], 1e-14))
        claims.append(Claim(f"power of {name}, `consistent`", ratios["consistent"][i], 1.0, 1e-14))
    tilt, _, yaw = ratios["as_printed"]
    compared = Comparison(
        "wheel torques of virtual torques",
        "eq. (8)",
        "the inverse of the printed matrix",
        f"it makes tilt torques {tilt:.2f} times, the yaw torque {yaw:.2f} times too large",
        "a map of rates, used for torques; virtual work requires its transposed inverse",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        ax = fig.subplots()
        zeniths = np.arange(20.0, 71.0, 5.0)
        robots = [params.replace(wheel_zenith=np.radians(zenith)) for zenith in zeniths]
        fine = np.radians(np.linspace(18.0, 72.0, 100))
        forms = (1.5 * ratio * np.cos(fine) ** 2, 3.0 * ratio * np.sin(fine) ** 2)
        names = ("τx, τy: 3/2 (r_k/r_w) cos² α", "τz: 3 (r_k/r_w) sin² α")
        for i, form, name, color in zip((0, 2), forms, names, COLORS[:2], strict=True):
            ax.plot(np.degrees(fine), form, color=color, label=name)
            found = [power_ratios(robot, "as_printed")[i] for robot in robots]
            ax.plot(zeniths, found, "o", markersize=4, color=color)
        consistent = [power_ratios(robot, "consistent") for robot in robots]
        ax.plot(zeniths, consistent, "s", markersize=4, color=INK)
        ax.axhline(1.0, color=INK, label="consistent")
        ax.axvline(45.0, color=INK, linewidth=0.8, linestyle=":")
        ax.set(xlabel="zenith angle α (deg)", ylabel="torque that arrives / requested for", ylim=(0.0, 6.8))
        ax.legend(loc="upper left")

    return Findings(claims, draw, compared=(compared,))


def eq_8(params: bb.Params) -> Array:
    """The matrix of eq. (8) as printed, before its inversion."""
    ratio = params.wheel_radius / params.ball_radius
    c, s = ratio / np.cos(params.wheel_zenith), ratio / np.sin(params.wheel_zenith)
    return np.array([[2 * c / 3, -c / 3, -c / 3], [0.0, c / np.sqrt(3), -c / np.sqrt(3)], [s / 3, s / 3, s / 3]])


def power_ratios(params: bb.Params, mapping: str) -> list[float]:
    """Ratio of the wheels' power to the power of each virtual torque."""
    model = bb.SpatialModel(params, ball_spins_about_vertical=True)
    r_w, ratio = params.wheel_radius, params.ball_radius / params.wheel_radius
    speed, tilt_rate, yaw_rate, spin = 0.3, 0.7, 0.4, 1.0
    # Eq. (8) counts τ_x and τ_y on the body, whose tilt θ_x leans towards +y and turns it about −x; τ_z on the ball.
    motions = (
        ((0.0, speed, -tilt_rate, 0.0, 0.0, 0.0), speed / r_w - ratio * tilt_rate),
        ((speed, 0.0, 0.0, tilt_rate, 0.0, 0.0), -(speed / r_w - ratio * tilt_rate)),
        ((0.0, 0.0, 0.0, 0.0, yaw_rate, spin), ratio * (spin - yaw_rate)),
    )
    ratios = []
    for unit, (velocity, rate) in zip(np.eye(3), motions, strict=True):
        torques = bb.virtual_to_wheel_torques(params, unit, mapping)
        ratios.append(float(torques @ model.wheel_speeds(UPRIGHT, velocity)) / rate)
    return ratios


def _largest(differences: Array) -> float:
    return float(np.abs(differences).max())
