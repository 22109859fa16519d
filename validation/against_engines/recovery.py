"""Recovery from 2 deg in closed loop.

One regulator (`Lqr` at 200 Hz, the same gains everywhere) brings the robot upright from a tilt of 2 deg, at a heading
of 0.5 rad, which favors no engine; 3 s. Each engine has its own state, steps are 1 ms.

- `spatial`, `contact` and `rigid` are ours: Kane's equations without slip, our contact solver, and rapier.
- *MuJoCo, no slip* is MuJoCo's mechanics of the two URDFs, ball and bot as free bodies, under MuJoCo's Runge-Kutta
  method. MuJoCo has no rolling constraint, so a control callback adds the contact forces which keep the ball from
  slipping on the floor and the wheels from slipping along their drive, found from MuJoCo's mass matrix, bias forces and
  Jacobians. It shares no equation of motion with `spatial`, only the geometry of the contacts.
- *MuJoCo, contacts* is stock MuJoCo with anisotropic elliptic friction cones, solved to a tolerance of $10^{-12}$. It
  lays a contact's friction directions by the world's axes, not by the wheel's. In *turned contacts* they are turned to
  the wheel between the two halves of MuJoCo's step: the best that we could get from contacts in this engine.
- *PyBullet* has anisotropic friction in the wheel's frame and 50 solver iterations.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.against_engines import trajectories
from validation.against_engines.engine_list import CONTACT, RIGID, ROLLING, engines
from validation.against_engines.trajectories import CONTROL_DT
from validation.topic import Findings

if TYPE_CHECKING:
    from validation.mechanics import Array

_SECONDS = 3.0
_YAW, _AZIMUTH, _TILT = 0.5, 0.7, np.radians(2.0)
_LIMITS = {ROLLING: 5e-11, CONTACT: 4e-3, RIGID: 4e-3}


def run() -> Findings:
    """Runs all engines."""
    params = bb.Params.paper()
    start = bb.State.at_rest(params, _TILT * np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH)]), _YAW)
    lqr, found = bb.Lqr(params, CONTROL_DT), engines()

    def law(state: bb.State, _time: float) -> "Array":
        return lqr(state, yaw=_YAW)

    runs = trajectories.in_all(found, params, start, law, _SECONDS)
    claims = [*trajectories.tilt_claims(runs, _LIMITS), *trajectories.load_claims(runs, 1e-7)]
    return trajectories.findings(claims, runs, found)
