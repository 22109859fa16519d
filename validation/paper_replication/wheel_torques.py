r"""Fig. 6c: wheel torques of ±5 N·m.

At rest upright each wheel carries $N = M_b g/(3\cos\alpha) = 10.30$ N. A wheel that does not speed up, under its load
at rest, transmits $\tau/r_w$, and friction no more than $\mu N$: it slips above $\mu \cdot 0.515$ N·m. A wheel that
speeds up keeps part of its torque, and the motors' reaction changes the loads; so the torque at which a wheel slips
varies, but it always has this magnitude (the table below). To transmit a steady 5 N·m a wheel would have to carry 91 N
($\mu = 1.1$), nine times its part of the weight. Torque beyond the bound spins the wheel up, by
$(\tau - \mu N r_w)/J_w = 30000$ rad/s² for 5 N·m.

The figure is the 3° incline of the section above with torques up to ±5 N·m in `rigid`: torques, with ± the largest
bound $\mu_d N r_w$ of the three wheels under their loads at the time; loads (dashed: at rest); slip speeds. The motors'
reaction lifts wheel 2 off in the first instant; it comes down again, hard, after 60 ms.
"""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.closed_forms import friction_limit
from validation.engines import probes
from validation.engines.our_robot import OurRobot
from validation.mechanics import Array, upright_mass
from validation.page import table
from validation.paper_replication.loop import PRINTED_TORQUE, balance
from validation.search import largest
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Error limits of the load at rest, and of the spin-up.
_MODELS = {"contact": (1e-14, 1e-12), "rigid": (1e-7, 5e-4)}
_INCLINE = 3.0
_DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


def run() -> Findings:
    """Loads, the onset of slip and the spin-up in both simulations."""
    params = bb.Params.paper()
    load, onset = probes.resting_load(params), friction_limit.slip_torque(params)
    claims = []
    for model, (at_rest, limit) in _MODELS.items():
        found = float(probes.wheel_loads(OurRobot(model, params, 1e-3), params)[0])
        claims.append(Claim(f"load of a wheel at rest, `{model}`", found, load, at_rest, "N"))
        slips = largest(partial(friction_limit.grips, params, model, 0.0), 0.0, 2.0, to=1e-6)
        claims.append(Claim(f"three equal torques at which the wheels slip, `{model}`", slips, onset, 2e-3, "N·m"))
        bound = params.wheel_dynamic_friction * load * params.wheel_radius
        expected = (PRINTED_TORQUE - bound) / params.wheel_inertia
        claims.append(
            Claim(f"spin-up of a wheel under 5 N·m, `{model}`", spin_up(params, model), expected, limit, "rad/s²")
        )
    steady = params.wheel_static_friction * load * params.wheel_radius
    compared = Comparison(
        "largest steady wheel torque",
        "Section III-B, Fig. 6c",
        "nearly ±5 N·m",
        f"{steady:.2f} N·m (static friction), {steady / 1.1:.2f} N·m (dynamic)",
        f"a wheel carries {load:.2f} N; μ N r_w is all that its contact transmits to a wheel that does not speed up",
    )
    coefficients = (params.wheel_static_friction, params.wheel_dynamic_friction)
    tilting = [tilt_onset(params, friction) for friction in coefficients]
    modeled = min(model_slips(params, tilted) for tilted in tilt_torques(params))
    claims.append(
        Claim("largest torque of a tilt at which a wheel slips, `SpatialModel`", modeled, tilting[1], 1e-9, "N·m")
    )
    dynamic = coefficients[1] / coefficients[0]
    rows = [
        ["of a wheel that does not speed up, under its load at rest, $\\mu N r_w$", steady, dynamic * steady],
        ["three equal torques: the wheels speed up with ball and body, loads stay", onset, dynamic * onset],
        ["a tilt torque in the worst direction: the reaction unloads a wheel", *tilting],
    ]
    markdown = table(
        [
            "torque (N·m) above which a wheel of the upright robot at rest slips",
            "μ = 1.1 (static)",
            "μ = 1.0 (dynamic)",
        ],
        [[str(name), *(f"{torque:.3f}" for torque in torques)] for name, *torques in rows],
    )
    r = balance("rigid", (_INCLINE, 0.0), max_torque=PRINTED_TORQUE, seconds=1.0)

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        axes = fig.subplots(1, 3)
        shown = int((r.times < 0.12).sum())
        milliseconds = 1e3 * r.times[:shown]
        bound = params.wheel_dynamic_friction * params.wheel_radius * r.loads[:shown]
        for i in range(3):
            color = COLORS[2 + i]
            axes[0].plot(milliseconds, r.torques[:shown, i], color=color, linewidth=1.2)
            axes[1].plot(milliseconds, r.loads[:shown, i], color=color, linewidth=1.0)
            axes[2].plot(milliseconds, r.slips[:shown, i], color=color, linewidth=1.2, label=f"wheel {i}")
        most = bound.max(axis=1)
        axes[0].fill_between(milliseconds, -most, most, color=INK, alpha=0.25, linewidth=0, label="± μ N r_w")
        axes[0].set(ylabel="wheel torque (N·m)", ylim=(-6.0, 9.5))
        for printed in (-PRINTED_TORQUE, PRINTED_TORQUE):
            axes[0].axhline(printed, color=INK, linestyle="--", linewidth=0.8)
        axes[1].axhline(load, color=INK, linestyle="--", linewidth=0.8)
        axes[1].set(ylabel="wheel load (N), impacts cut off", ylim=(-2.0, 60.0))
        axes[2].set_ylabel("slip speed (m/s)")
        for ax in axes:
            ax.set_xlabel("time (ms)")
        axes[0].legend(handles=axes[0].collections, loc="upper right", fontsize=8)
        axes[2].legend(loc="lower left", fontsize=8)

    return Findings(claims, draw, markdown, compared=(compared,))


def tilt_onset(params: bb.Params, friction: float) -> float:
    """Largest wheel torque of a tilt torque at which a wheel slips, in the worst direction, closed form, N·m.

    The planar equations with absolute spins give the accelerations of ball and mast, and these the tractions and loads
    of docs/derivations.md.
    """
    p, alpha = params, params.wheel_zenith
    drive = 1.5 * np.cos(alpha) * np.array([1.0, -p.ball_radius]) / p.wheel_radius
    ball, mast = np.linalg.solve(upright_mass(p), drive)
    carried = p.body_mass * (ball + p.body_com_height * mast)
    pushed = (p.ball_inertia / p.ball_radius**2 + p.ball_mass) * ball + carried
    traction = 2.0 * pushed / (3.0 * np.cos(alpha))
    unloading = 2.0 / (3.0 * np.sin(alpha)) * (carried + pushed / np.cos(alpha))
    load, onsets = probes.resting_load(p), []
    for direction in _DIRECTIONS:
        angles = np.array(p.wheel_azimuths) - direction
        slopes = np.abs(traction * np.cos(angles)) - friction * unloading * np.sin(angles)
        largest_torque = float(np.abs(np.cos(angles)).max())
        onsets += [largest_torque * friction * load / slope for slope in slopes if slope > 0.0]
    return float(min(onsets))


def tilt_torques(params: bb.Params) -> list[Array]:
    """Wheel torques of tilts in all directions, the largest 1 N·m."""
    torques = [bb.virtual_to_wheel_torques(params, (np.cos(a), np.sin(a), 0.0)) for a in _DIRECTIONS]
    return [t / np.abs(t).max() for t in torques]


def model_slips(params: bb.Params, torques: Array) -> float:
    """Multiple of these torques at which dynamic friction no longer holds all wheels, by `SpatialModel.contacts`."""
    model, upright, rest = bb.SpatialModel(params, ball_spins_about_vertical=True), (1.0, 0.0, 0.0, 0.0), np.zeros(6)
    load = model.contacts(upright, rest, np.zeros(3)).wheel_normal_forces
    driven = model.contacts(upright, rest, torques)
    friction = params.wheel_dynamic_friction
    slopes = np.abs(driven.wheel_tractions) - friction * (driven.wheel_normal_forces - load)
    return float(min(friction * load[slopes > 0.0] / slopes[slopes > 0.0]))


def spin_up(params: bb.Params, model: str) -> float:
    """Angular acceleration of wheel 0, by its absolute spin, under 5 N·m on all wheels, rad/s²."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.step(np.zeros(3), steps=20)
    spins = []
    for _ in range(2):
        robot.step(np.full(3, PRINTED_TORQUE), steps=10)
        state = robot.state
        # Minus the contribution of the body's yaw rate to the encoder.
        spins.append(float(state.wheel_speeds[0] - np.sin(params.wheel_zenith) * state.body_angular_velocity[2]))
    return (spins[1] - spins[0]) / 0.01
