r"""Eqs. (2) and (7): wheel inertia.

The virtual wheel of eq. (2) has the inertia $J_w$ of one omniwheel. Three of them amount to
$\tfrac{3}{2}\cos^2\alpha\ J_w$ about a horizontal axis. Eq. (7) does count three, $3 J_w\sin^2\alpha$. Both take the
spin of the wheels relative to the body; a wheel's kinetic energy goes by its absolute spin, which adds the body's own
rate along its axle. So there are three robots:

- as printed: `PlanarModel(params)`;
- three wheels, relative spin: `PlanarModel(params, "three_wheels")`, and `SpatialModel(params,
  absolute_wheel_spin=False)`, equal in a plane;
- three wheels, absolute spin: `SpatialModel(params)`, and what the rigid bodies of `contact` and `rigid` do.

Expected are closed forms: $\lambda = \sqrt{M_b g l\ M_{11}/\det M}$ with the $M$ of eq. (2), and eq. (7) written out;
for absolute spins both with $r_k/r_w + 1$ where it is the body's own rate that turns the wheels.

For the fall of the upright robot the difference is below one per cent. For yaw it is not: the body's inertia about the
mast is only nine times the geared inertia of the three wheels, and eq. (7) is off by 13 % from rigid bodies.
"""

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import unstable_pole, yaw_gain
from validation.page import table
from validation.topic import Comparison, Findings

_YAW_TORQUE = 0.01


def run() -> Findings:
    """Poles and yaw gains of all variants."""
    params = bb.Params.paper()
    poles = {
        "as printed": _planar_pole(params, "as_printed"),
        "three wheels, relative spin": _planar_pole(params, "three_wheels"),
        "three wheels, absolute spin": _spatial_pole(params),
    }
    expected = (
        unstable_pole(params, wheel_share=1.0, absolute_wheel_spin=False),
        unstable_pole(params, absolute_wheel_spin=False),
        unstable_pole(params),
    )
    printed = eq_7()
    gains = {
        "as printed": bb.PlanarModel(params).yaw_acceleration(1.0),
        "three wheels, relative spin": _spatial_yaw_gain(params, absolute=False),
        "three wheels, absolute spin": _spatial_yaw_gain(params, absolute=True),
    }
    pinned = _spatial_yaw_gain(params, absolute=False, ball_spins=False)
    claims = [
        *(
            Claim(f"pole, {name}", found, pole, limit, "1/s")
            for (name, found), pole, limit in zip(poles.items(), expected, (1e-14, 1e-14, 1e-9), strict=True)
        ),
        Claim(
            "yaw gain of `PlanarModel`, against eq. (7) written out", gains["as printed"], printed, 1e-14, "1/(kg·m²)"
        ),
        Claim(
            "yaw gain of `SpatialModel`, relative spin, against eq. (7)",
            gains["three wheels, relative spin"],
            printed,
            1e-14,
            "1/(kg·m²)",
        ),
        Claim(
            "yaw gain of `SpatialModel`, absolute spin",
            gains["three wheels, absolute spin"],
            yaw_gain(params),
            1e-14,
            "1/(kg·m²)",
        ),
    ]
    for model, limit in (("contact", 1e-10), ("rigid", 1e-8)):
        found = _simulated_yaw_gain(params, model)
        claims.append(Claim(f"yaw gain, `{model}`, against absolute spin", found, yaw_gain(params), limit, "1/(kg·m²)"))
    rows = [[name, f"±{poles[name]:.5f}", f"{gains[name]:.4f}"] for name in poles]
    head = ["", "poles of the upright robot (1/s)", "yaw gain (rad/s² per N·m)"]
    text = (
        f"{table(head, rows)}\n\nWithout $B_{{vk}}$; two more poles are zero. Eq. (7) lets the ball spin about "
        f"the vertical, as a point contact does; with that spin pinned the gain would be {pinned:.2f}. "
        "With $B_{vk} = 49.849$ the poles as printed are "
        f"{', '.join(f'{pole:.4f}' for pole in _damped_poles(params))} and 0."
    )
    compared = (
        Comparison(
            "inertia of the virtual wheel",
            "eq. (2)",
            "J_w",
            f"3/2 cos²α J_w = 0.75 J_w: growth of a fall {poles['three wheels, relative spin']:.4f} instead of "
            f"{poles['as printed']:.4f} 1/s; with absolute spins {poles['three wheels, absolute spin']:.4f}",
            "one virtual wheel replaces three; spin counted relative to the body",
        ),
        Comparison(
            "yaw gain",
            "eq. (7)",
            f"{printed:.2f} rad/s² per N·m, by Table II",
            f"the same from the same assumptions; {gains['three wheels, absolute spin']:.2f} with absolute spins, "
            "in `contact` and `rigid`",
            "eq. (7) counts the wheels' spin relative to the body",
        ),
    )
    return Findings(claims, markdown=text, compared=compared)


def eq_7() -> float:
    """θ̈_z over τ_z, in the paper's symbols."""
    j_k, j_z, j_w, r_k, r_w, alpha = 0.0112, 0.0137, 0.000149, 0.112, 0.05, np.pi / 4
    return float(j_k * r_k * r_w / (j_k * j_z * r_w**2 + 3 * (j_k + j_z) * j_w * r_k**2 * np.sin(alpha) ** 2))


def _spatial_pole(params: bb.Params) -> float:
    """Pole of `SpatialModel`, by the difference quotient of its accelerations over a small tilt."""
    model, angle = bb.SpatialModel(params, ball_spins_about_vertical=False), 1e-6
    tilted = np.array([np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0])
    upright, rest, torque = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(5), np.zeros(3)
    slope = model.accelerations(tilted, rest, torque) - model.accelerations(upright, rest, torque)
    return float(np.sqrt(slope[2] / angle))


def _planar_pole(params: bb.Params, inertia: str) -> float:
    return float(np.linalg.eigvals(bb.PlanarModel(params, inertia).linearize()[0]).real.max())


def _damped_poles(params: bb.Params) -> list[float]:
    damped = params.replace(ball_viscous_friction=bb.PAPER_BALL_VISCOUS_FRICTION)
    poles = np.linalg.eigvals(bb.PlanarModel(damped).linearize()[0]).real
    return sorted(float(pole) for pole in poles if abs(pole) > 1e-9)


def _spatial_yaw_gain(params: bb.Params, absolute: bool, ball_spins: bool = True) -> float:
    model = bb.SpatialModel(params, absolute, ball_spins)
    # Eq. (8) counts τ_z on the ball, eq. (7) on the body.
    torques = bb.virtual_to_wheel_torques(params, (0.0, 0.0, -1.0))
    return float(model.accelerations((1.0, 0.0, 0.0, 0.0), np.zeros(6 if ball_spins else 5), torques)[4])


def _simulated_yaw_gain(params: bb.Params, model: str) -> float:
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.step(np.zeros(3), steps=50)
    robot.step(bb.virtual_to_wheel_torques(params, (0.0, 0.0, -_YAW_TORQUE)), steps=100)
    return float(robot.state.body_angular_velocity[2]) / (0.1 * _YAW_TORQUE)
