r"""A body that tumbles in free flight.

With wheels of no inertia the bot is a symmetric top: its angular momentum $L$ is fixed in space, and its attitude is a
turn about $L$ at $|L|/J_b$ after a turn about its own mast at $\Omega_z (1 - J_z/J_b)$. With the wheels of Table II,
which are free to spin up, angular momentum and energy must still be kept: the wheels' own are part of them. A step
turns the body by the rate at its end, so momentum is read with the attitude half a step back: what is left of it in
both simulations is of second order. Both take the gyroscopic torque of the middle of a step; `rigid` finds the middle
to rounding, and keeps the energy to rounding.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation import momentum
from validation.claim import Claim
from validation.engines.rotations import matrix
from validation.mechanics import Array, turn
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RATE = np.array([4.0, 1.0, 9.0])
_HEIGHT, _SECONDS = 20.0, 1.0
#: Of the mast's direction (deg) against the closed form, of angular momentum and of energy, at 1 kHz; and by what half
#: the step multiplies the last two.
_LIMITS: dict[str, tuple[float, float, float, tuple[float, float | None]]] = {
    "contact": (0.6, 1e-4, 1e-6, (0.25, 0.125)),
    "rigid": (0.6, 1e-4, 1e-10, (0.25, None)),
}


def run() -> Findings:
    """Lets the bot tumble in each simulation, with and without inertia of the wheels."""
    params = bb.Params.paper()
    top = params.replace(wheel_inertia=1e-9)
    steps = round(_SECONDS / 1e-3)
    times = np.arange(1, steps + 1) * 1e-3
    masts = np.array([attitude(top, t)[:, 2] for t in times])
    claims, off, tilts = [], {}, {}
    for model, (angle, turning, energy, orders) in _LIMITS.items():
        flown = fly(top, model, 1e-3, steps)
        off[model], tilts[model] = apart(masts, flown), np.degrees([state.tilt for state in flown])
        finer = apart(masts, fly(top, model, 5e-4, 2 * steps)[1::2])
        drift, halved = drifts(params, model, 1e-3, steps), drifts(params, model, 5e-4, 2 * steps)
        claims += [
            Claim(f"mast against closed form, worst, `{model}`", off[model].max(), 0.0, angle, "deg", absolute=True),
            Claim(f"the same at 2 kHz over that at 1 kHz, `{model}`", finer.max() / off[model].max(), 0.5, 2e-2),
            Claim(f"angular momentum, share lost or gained, `{model}`", drift[0], 0.0, turning, "", absolute=True),
            Claim(f"energy, share lost or gained, `{model}`", drift[1], 0.0, energy, "", absolute=True),
        ]
        for name, whole, half, ratio in zip(("angular momentum", "energy"), drift, halved, orders, strict=True):
            if ratio is None:
                continue
            what = f"error of the {name} at 2 kHz over that at 1 kHz, `{model}`"
            claims.append(Claim(what, half / whole, ratio, 5e-2))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS
        from ballbot_rs.media.figures.style import INK

        left, right = fig.subplots(1, 2)
        exact = np.degrees(np.arccos(masts[:, 2]))
        left.plot(times, exact, color=INK, linewidth=6, alpha=0.2, label="closed form")
        for model, found in tilts.items():
            left.plot(times, found, label=model, **MODEL_LOOKS[model])
        left.set(xlabel="time (s)", ylabel="tilt of the mast (deg)")
        left.legend()
        for model, angles in off.items():
            right.semilogy(times, angles + 1e-12, label=model, **MODEL_LOOKS[model])
        right.set(xlabel="time (s)", ylabel="mast against closed form (deg)")
        right.legend()

    return Findings(claims, draw)


def attitude(params: bb.Params, time: float) -> Array:
    """Rotation matrix of the symmetric top, upright at time zero."""
    transverse, _, axial = params.body_inertia
    kept = np.array([transverse, transverse, axial]) * _RATE
    size = float(np.linalg.norm(kept))
    precession = turn(kept / size, size / transverse * time)
    return precession @ turn(np.array([0.0, 0.0, 1.0]), _RATE[2] * (1.0 - axial / transverse) * time)


def fly(params: bb.Params, model: str, sim_dt: float, steps: int) -> list[bb.State]:
    """States after each step; ball and bot start far apart, the bot tumbling high above."""
    robot = bb.Ballbot(params, model=model, sim_dt=sim_dt)
    upright = bb.State.at_rest(params)
    robot.reset(
        upright.replace(
            body_position=upright.body_position + np.array([0.0, 0.0, _HEIGHT]),
            body_velocity=np.zeros(3),
            body_angular_velocity=_RATE,
        )
    )
    states = []
    for _ in range(steps):
        robot.step(np.zeros(3))
        states.append(robot.state)
    return states


def apart(masts: Array, states: list[bb.State]) -> Array:
    """Angles between these masts and the masts of the states, deg."""
    found = np.array([matrix(state.body_quaternion)[:, 2] for state in states])
    angles: Array = np.degrees(2.0 * np.arcsin(0.5 * np.linalg.norm(found - masts, axis=1)))
    return angles


def drifts(params: bb.Params, model: str, sim_dt: float, steps: int) -> tuple[float, float]:
    """Largest relative change of the bot's angular momentum and of its energy of rotation."""
    rows = [momentum.rotation(params, state, 0.5 * sim_dt) for state in fly(params, model, sim_dt, steps)]
    momenta, energies = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    lost = np.linalg.norm(momenta - momenta[0], axis=1).max() / np.linalg.norm(momenta[0])
    return float(lost), float(np.abs(energies / energies[0] - 1.0).max())
