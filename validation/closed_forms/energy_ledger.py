r"""The energy ledger.

Whatever the motors put in must be found again: in the kinetic and potential energy, or lost to friction.

$$E_1 - E_0 = \int \sum_i\tau_i\dot\psi_i\ dt - \int \sum_i f_i s_i\ dt + \int F\cdot v_s\ dt
- \int \bigl(B_{vk}|v|^2 + B_{vm}|\dot\psi|^2\bigr)dt$$

On the right: the work of the motors, what the slipping wheels lose (traction times slip), what the slipping ball loses
on the floor, and what viscous friction takes. No friction may give energy: in every step $f_i s_i \ge 0$ for each
wheel that slips at its end and $-F\cdot v_s \ge 0$ for a ball that does. A contact that holds is seen to slip by some
10 µm/s (1 mm/s counts as slip), since the robot has turned a little by the end of the step; what this gives is counted
apart.

The robot is driven hard for two seconds: a ride under the regulator with torques beyond the wheels' grip and viscous
friction at ball and wheels, from a start (where the model can slip) with the wheels spinning. Power is taken with the
speeds midway through each step; the gap that is left is the step's own error.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT, _SECONDS = 1e-3, 2.0
_ENTRIES = ("energy", "motors", "wheel slip", "floor slip", "viscous")
_LIMITS = {"spatial": 1e-6, "contact": 2e-4, "rigid": 2e-4}
#: A contact slips above this, m/s.
_SLIPS = 1e-3
#: Fraction of the turnover that sticking contacts may give, by turning within a step.
_GIVEN = {"contact": 1e-3, "rigid": 2e-4}


class Given(NamedTuple):
    """Energy that friction gave instead of dissipating: largest power in slip (W), total energy in stick (J)."""

    slipping: float
    holding: float


def run() -> Findings:
    """Keeps the ledger along a hard ride in each model."""
    claims, ledgers = [], {}
    for model, limit in _LIMITS.items():
        ledgers[model], given = ledger(model, _DT)
        gap, turnover = open_gap(ledgers[model])
        claims.append(
            Claim(f"gap of the ledger over the turnover, `{model}`", gap / turnover, 0.0, limit, absolute=True)
        )
        if model in _GIVEN:
            what = f"largest power that the friction of a slipping contact gives in any step, `{model}`"
            claims.append(Claim(what, given.slipping, 0.0, 0.0, "W", absolute=True))
            what = f"what holding contacts give, over the turnover, `{model}`"
            claims.append(Claim(what, given.holding / turnover, 0.0, _GIVEN[model], absolute=True))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS, look

        left, right = fig.subplots(1, 2)
        times = np.arange(len(ledgers["contact"])) * _DT
        for number, (name, column) in enumerate(zip(_ENTRIES, ledgers["contact"].T, strict=True)):
            left.plot(times, column, label=name, **look(number))
        left.set(xlabel="time (s)", ylabel="energy and work (J)", title="entries of the ledger, contact")
        left.legend()
        for model, entries in ledgers.items():
            right.semilogy(times, np.abs(gap_of(entries)) + 1e-12, label=model, **MODEL_LOOKS[model])
        right.set(xlabel="time (s)", ylabel="gap (J)", title="gap of the ledger, all models")
        right.legend()

    return Findings(claims, draw)


def ledger(model: str, sim_dt: float) -> tuple[Array, Given]:
    """One row per step of [`_ENTRIES`], each summed since the start, J; and the energy that friction gave."""
    params = bb.Params.paper().replace(
        ball_viscous_friction=2.0, wheel_viscous_friction=1e-4, wheel_static_friction=0.4, wheel_dynamic_friction=0.35
    )
    robot = bb.Ballbot(params, model=model, sim_dt=sim_dt)
    regulator = bb.Lqr(params, control_dt=0.005, max_torque=0.3)
    start = bb.State.at_rest(params, tilt=(0.05, -0.03), yaw=0.2)
    robot.reset(start if model == "spatial" else start.replace(wheel_speeds=[30.0, 30.0, 30.0]))
    substeps = round(0.005 / sim_dt)
    rows, sums, first, given = [np.zeros(5)], np.zeros(4), robot.energy, {True: 0.0, False: 0.0}
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
        powers = [*(contacts.wheel_tractions * contacts.wheel_slip_speeds)]
        powers.append(-contacts.floor_force[:2] @ contacts.floor_slip_velocity)
        speeds = [*np.abs(contacts.wheel_slip_speeds), np.linalg.norm(contacts.floor_slip_velocity)]
        for power, speed in zip(powers, speeds, strict=True):
            slips = speed > _SLIPS
            given[slips] = (
                max(given[slips], -float(power)) if slips else given[slips] + max(0.0, -float(power)) * sim_dt
            )
        wheel_slip, floor_slip = contacts.wheel_slip_speeds, contacts.floor_slip_velocity
        rows.append(np.array([robot.energy - first, *sums]))
    return np.array(rows), Given(given[True], given[False])


def gap_of(entries: Array) -> Array:
    """Imbalance of the ledger, J."""
    return np.asarray(entries[:, 0] - entries[:, 1] + entries[:, 2:].sum(axis=1))


def open_gap(entries: Array) -> tuple[float, float]:
    """Largest gap, and the turnover: all motor work, put in or taken out, J."""
    return float(np.abs(gap_of(entries)).max()), float(np.abs(np.diff(entries[:, 1])).sum())
