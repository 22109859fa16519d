r"""Fig. 6c: wheel torques of ±5 N·m.

At rest upright each wheel carries $N = M_b g/(3\cos\alpha) = 10.30$ N. A wheel that does not speed up passes on
$\tau/r_w$, and friction no more than $\mu N$: above $\mu \cdot 0.515$ N·m it slips, whatever the controller. To pass
on a steady 5 N·m it would have to carry 91 N ($\mu = 1.1$), nine times its share of the weight. What exceeds the
bound spins the wheel up, by $(\tau - \mu N r_w)/J_w = 30000$ rad/s² for 5 N·m.

The figure is the 3° incline of the section above with torques up to ±5 N·m in `rigid`: torques, beside ± the largest
bound $\mu_d N r_w$ that any of the wheels has with its load at the time; loads (dashed: at rest); slip speeds. The
motors' reaction lifts wheel 3 off in the first instant; it comes down again, hard, after 60 ms.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.paper.loop import PRINTED_TORQUE, balance
from verification.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MODELS = {"contact": 1e-3, "rigid": 2e-2}
_INCLINE = 3.0


def run() -> Findings:
    """Loads, the onset of slip and the spin-up in both simulations."""
    params = bb.Params.paper()
    load = static_load(params)
    claims = []
    for model, limit in _MODELS.items():
        robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
        robot.step(np.zeros(3), steps=300)
        found = float(robot.contacts.wheel_normal_forces[0])
        claims.append(Claim(f"load of a wheel at rest, `{model}`", found, load, 1e-6, "N"))
        claims.append(
            Claim(
                f"torque of each wheel at which it slips, `{model}`",
                slip_torque(params, model),
                onset(params),
                5e-3,
                "N·m",
            )
        )
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
        f"a wheel carries {load:.2f} N; μ N r_w is all that its contact passes on",
    )
    r = balance("rigid", (_INCLINE, 0.0), max_torque=PRINTED_TORQUE, seconds=1.0)

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import COLOURS, INK

        axes = fig.subplots(1, 3)
        shown = int((r.times < 0.12).sum())
        milliseconds = 1e3 * r.times[:shown]
        bound = params.wheel_dynamic_friction * params.wheel_radius * r.loads[:shown]
        for i in range(3):
            colour = COLOURS[i]
            axes[0].plot(milliseconds, r.torques[:shown, i], color=colour, linewidth=1.2)
            axes[1].plot(milliseconds, r.loads[:shown, i], color=colour, linewidth=1.0)
            axes[2].plot(milliseconds, r.slips[:shown, i], color=colour, linewidth=1.2, label=f"wheel {i + 1}")
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

    return Findings(claims, draw, compared=(compared,))


def static_load(params: bb.Params) -> float:
    """Of a wheel of the robot at rest upright, N."""
    return params.body_mass * params.gravity / (3.0 * float(np.cos(params.wheel_zenith)))


def onset(params: bb.Params) -> float:
    """Torque, the same for all wheels, at which they slip: part of it turns the wheels with ball and body."""
    model = bb.SpatialModel(params, ball_spins_about_vertical=True)
    contacts = model.contacts((1.0, 0.0, 0.0, 0.0), np.zeros(6), np.ones(3))
    return params.wheel_static_friction * static_load(params) / abs(float(contacts.wheel_tractions[0]))


def slip_torque(params: bb.Params, model: str) -> float:
    """The same by bisection in a simulation."""
    low, high = 0.1, 2.0
    while high - low > 1e-3:
        torque = 0.5 * (low + high)
        robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
        robot.step(np.zeros(3), steps=20)
        robot.step(np.full(3, torque), steps=30)
        if abs(float(robot.contacts.wheel_slip_speeds[0])) > 1e-3:
            high = torque
        else:
            low = torque
    return 0.5 * (low + high)


def spin_up(params: bb.Params, model: str) -> float:
    """Angular acceleration of wheel 1, by its absolute spin, under 5 N·m on all wheels, rad/s²."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.step(np.zeros(3), steps=20)
    spins = []
    for _ in range(2):
        robot.step(np.full(3, PRINTED_TORQUE), steps=10)
        state = robot.state
        # Less what the body's turning about the vertical takes from the encoder.
        spins.append(float(state.wheel_speeds[0] - np.sin(params.wheel_zenith) * state.body_angular_velocity[2]))
    return (spins[1] - spins[0]) / 0.01
