r"""The same torques in open loop.

Nothing steers here: from rest upright each wheel follows its own gentle sine, up to 10 mN·m, held over 5 ms. Nothing
hides an error either, as any early difference grows by $\cosh(6.09\cdot 0.8) = 65$ in these 0.8 s.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.against_engines import trajectories
from validation.against_engines.engine_list import CONTACT, RIGID, ROLLING, SIM_DT, SPATIAL, engines
from validation.against_engines.trajectories import Trajectory
from validation.claim import Claim
from validation.engines.our_robot import OurRobot
from validation.topic import Findings

if TYPE_CHECKING:
    from validation.mechanics import Array

_SECONDS = 0.8
_YAW = 0.5
_TORQUE, _FREQUENCIES, _PHASES = 0.01, np.array([1.1, 1.7, 2.3]), np.array([0.0, 1.0, 2.0])
_LIMITS = {ROLLING: 5e-11, CONTACT: 0.04, RIGID: 0.04}


def run() -> Findings:
    """Runs all engines."""
    params, found = bb.Params.paper(), engines()
    start = bb.State.at_rest(params, yaw=_YAW)

    def law(_state: bb.State, time: float) -> "Array":
        return np.asarray(_TORQUE * np.sin(2.0 * np.pi * _FREQUENCIES * time + _PHASES))

    runs = trajectories.in_all(found, params, start, law, _SECONDS)
    claims = trajectories.tilt_claims(runs, _LIMITS, f" over {_SECONDS} s")

    robot = OurRobot(CONTACT, params, 0.5 * SIM_DT)
    halved, _, _ = Trajectory(robot, start, law, _SECONDS).strays(runs[SPATIAL])
    whole, _, _ = runs[CONTACT].strays(runs[SPATIAL])
    claims.append(Claim(f"{CONTACT}: the same over that with half the step", whole / halved, 2.0, 5e-3))
    claims += trajectories.load_claims(runs, 5e-7)
    return trajectories.findings(claims, runs, found)
