r"""Uneven wheels.

Wheels at uneven azimuths (`wheel_azimuths`) or zeniths (`wheel_zenith_offsets`) carry uneven loads. Without torque the
loads balance the weight, $\sum N_i p_i = M_b g\ e$ with $e$ the vertical in the body frame and $p_i$ the directions of
the contacts:

$$N = M_b g\ P^{-1} e,\qquad P = (p_0\ p_1\ p_2).$$

In the table wheel 1, by default at 120°, is turned towards wheel 2. A controller that is not designed for this drives
in the wrong direction. LQR made for the robot drives in the right direction, and limits its torques by the loads of
these wheels.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def azimuths(degrees: float) -> list[float]:
    """Azimuths of the wheels with wheel 1 turned, rad."""
    return [0.0, float(np.radians(120.0 + degrees)), float(np.radians(240.0))]


SWEEP = Sweep(
    "wheel 1 off its azimuth (deg)",
    (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 55.0),
    lambda degrees: drawn("wheel_azimuths", "abs", azimuths(degrees)),
    0.1,
    '--set \'events=[{"term": "wheel_azimuths", "op": "add", "range": [[0, 0], [0.1745, 0.1745], [0, 0]]}]\'',
    lambda degrees: PAPER.replace(wheel_azimuths=azimuths(degrees)),
)
_ROBOTS = {
    "wheel 1 off by 30 deg": PAPER.replace(wheel_azimuths=azimuths(30.0)),
    "wheel 2 higher by 5 deg": PAPER.replace(wheel_zenith_offsets=(0.0, 0.0, float(np.radians(-5.0)))),
}


def loads(params: bb.Params) -> Array:
    """Closed form of the loads in equilibrium of a robot with its CoM on the mast, N."""
    zeniths, around = np.array(params.wheel_zeniths), np.array(params.wheel_azimuths)
    contacts = np.stack([np.sin(zeniths) * np.cos(around), np.sin(zeniths) * np.sin(around), np.cos(zeniths)])
    found: Array = np.linalg.solve(contacts, [0.0, 0.0, params.body_mass * params.gravity])
    return found


def measured_loads(params: bb.Params) -> Array:
    """The same in `contact` at rest, N."""
    robot = bb.Ballbot(params, "contact", 0.001)
    robot.reset(bb.State.at_equilibrium(params))
    robot.step(np.zeros(3), 3)
    return robot.contacts.wheel_normal_forces


def claims() -> list[Claim]:
    """Loads of each wheel."""
    return [
        Claim(f"load of wheel {wheel}, {name}", float(found), float(expected), 1e-9, "N")
        for name, params in _ROBOTS.items()
        for wheel, (found, expected) in enumerate(zip(measured_loads(params), loads(params), strict=True))
    ]


def run() -> Findings:
    """Sweeps the azimuth of a wheel."""
    measured = Measured(SWEEP)
    robots = [PAPER.replace(wheel_azimuths=azimuths(degrees)) for degrees in SWEEP.values]
    lines, dots = np.array([loads(p) for p in robots]), np.array([measured_loads(p) for p in robots])

    def draw(fig: "Figure") -> None:
        left, middle, right = fig.subplots(1, 3)
        for wheel in range(3):
            (line,) = left.plot(SWEEP.values, lines[:, wheel], label=f"wheel {wheel}")
            left.plot(SWEEP.values, dots[:, wheel], "o", color=line.get_color())
        left.set(xlabel=SWEEP.label, ylabel="load in equilibrium (N)")
        left.legend()
        measured.draw(middle, right)

    return Findings(claims(), draw, measured.markdown(), (10.0, 3.2))
