r"""The energy ledger.

Whatever the motors put in must be found again: in the kinetic and potential energy, or lost to friction.

$$E_1 - E_0 = \int \sum_i\tau_i\dot\psi_i\ dt - \int \sum_i |f_i s_i|\ dt - \int |F\cdot v_s|\ dt
- \int \bigl(B_{vk}|v|^2 + B_{vm}|\dot\psi|^2\bigr)dt$$

On the right: the work of the motors, what the slipping wheels lose (traction times slip), what the slipping ball
loses on the floor, and what viscous friction takes.

The robot is driven hard for two seconds: a ride under the regulator with torques beyond the wheels' grip and viscous
friction at ball and wheels, from a start (where the model can slip) with the wheels spinning. Power is taken with the
speeds midway through each step. The ledger is closed to within 0.1 % of what went through it.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.robots import Array
from verification.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT, _SECONDS = 1e-3, 2.0
_ENTRIES = ("energy", "motors", "wheel slip", "floor slip", "viscous")
_LIMITS = {"spatial": 1e-3, "contact": 1e-3, "rigid": 1e-3}


def run() -> Findings:
    """Keeps the ledger along a hard ride in each model."""
    claims, ledgers = [], {}
    for model, limit in _LIMITS.items():
        ledgers[model] = ledger(model, _DT)
        gap, turnover = open_gap(ledgers[model])
        claims.append(
            Claim(f"gap of the ledger over the turnover, `{model}`", gap / turnover, 0.0, limit, absolute=True)
        )
    slip = float(ledgers["contact"][-1, 2])
    claims.append(Claim("energy lost to slipping wheels is a real part, `contact`", slip, 0.1, 10.0, "J", True))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.plotting.style import MODEL_COLOURS

        left, right = fig.subplots(1, 2)
        times = np.arange(len(ledgers["contact"])) * _DT
        for name, column in zip(_ENTRIES, ledgers["contact"].T, strict=True):
            left.plot(times, column, label=name)
        left.set(xlabel="time (s)", ylabel="J", title="entries, contact")
        left.legend()
        for model, entries in ledgers.items():
            right.semilogy(times, np.abs(gap_of(entries)) + 1e-12, color=MODEL_COLOURS[model], label=model)
        right.set(xlabel="time (s)", ylabel="gap (J)")
        right.legend()

    return Findings(claims, draw)


def ledger(model: str, sim_dt: float) -> Array:
    """A row a step of [`_ENTRIES`], each summed since the start, J."""
    params = bb.Params.paper().replace(
        ball_viscous_friction=2.0, wheel_viscous_friction=1e-4, wheel_static_friction=0.4, wheel_dynamic_friction=0.35
    )
    robot = bb.Ballbot(params, model=model, sim_dt=sim_dt)
    regulator = bb.Lqr(params, control_dt=0.005, max_torque=0.3)
    start = bb.State.upright(params, tilt=(0.05, -0.03), yaw=0.2)
    robot.reset(start if model == "spatial" else start.replace(wheel_speeds=[30.0, 30.0, 30.0]))
    substeps = round(0.005 / sim_dt)
    rows, sums, first = [np.zeros(5)], np.zeros(4), robot.energy
    # Ball and body start at rest.
    wheel_slip, floor_slip = params.wheel_radius * robot.state.wheel_speeds, np.zeros(2)
    for k in range(round(_SECONDS / sim_dt)):
        before = robot.state
        if k % substeps == 0:
            seconds = k * sim_dt
            target = 0.3 * np.array([np.sin(3.0 * seconds), np.cos(2.0 * seconds) - 1.0])
            torques = regulator(before, position=target, yaw=0.2 + 0.5 * seconds)
        robot.step(torques)
        after, contacts = robot.state, robot.contacts
        rolled = 0.5 * (before.ball_velocity + after.ball_velocity)
        spun = 0.5 * (before.wheel_speeds + after.wheel_speeds)
        sums += [
            torques @ spun * sim_dt,
            contacts.wheel_tractions @ (wheel_slip + contacts.wheel_slip_speeds) * 0.5 * sim_dt,
            -contacts.floor_force[:2] @ (floor_slip + contacts.floor_slip_velocity) * 0.5 * sim_dt,
            (params.ball_viscous_friction * rolled @ rolled + params.wheel_viscous_friction * spun @ spun) * sim_dt,
        ]
        wheel_slip, floor_slip = contacts.wheel_slip_speeds, contacts.floor_slip_velocity
        rows.append(np.array([robot.energy - first, *sums]))
    return np.array(rows)


def gap_of(entries: Array) -> Array:
    """What the ledger lacks, J."""
    return np.asarray(entries[:, 0] - entries[:, 1] + entries[:, 2:].sum(axis=1))


def open_gap(entries: Array) -> tuple[float, float]:
    """Largest gap, and the turnover: all motor work, put in or taken out, J."""
    return float(np.abs(gap_of(entries)).max()), float(np.abs(np.diff(entries[:, 1])).sum())
