r"""The same torques in open loop.

Nothing steers here: from rest upright each wheel follows its own gentle sine, up to 10 mN·m, held over 5 ms. Nothing
hides an error either, as any early difference grows by $\cosh(6.09\cdot 0.8) = 65$ in these 0.8 s.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from peers.our_robot import OurRobot
from verification.claim import Claim
from verification.engines import trajectories
from verification.engines.robots import CONTACT, RIGID, ROLLING, SIM_DT, SPATIAL, absent, engines
from verification.engines.trajectories import Trajectory
from verification.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from verification.robots import Array

_SECONDS = 0.8
_YAW = 0.5
_TORQUE, _FREQUENCIES, _PHASES = 0.01, np.array([1.1, 1.7, 2.3]), np.array([0.0, 1.0, 2.0])
_LIMITS = {ROLLING: 5e-11, CONTACT: 0.04, RIGID: 0.04}


def run() -> Findings:
    """Runs all engines."""
    params, found = bb.Params.paper(), engines()
    start = bb.State.upright(params, yaw=_YAW)

    def law(_state: bb.State, time: float) -> "Array":
        return np.asarray(_TORQUE * np.sin(2.0 * np.pi * _FREQUENCIES * time + _PHASES))

    runs = {e.name: Trajectory(e.make(params), start, law, _SECONDS) for e in found if not e.reason}
    claims = trajectories.tilt_claims(runs, _LIMITS, f" over {_SECONDS} s")

    robot = OurRobot(CONTACT, params, 0.5 * SIM_DT)
    halved, _, _ = Trajectory(robot, start, law, _SECONDS).strays(runs[SPATIAL])
    whole, _, _ = runs[CONTACT].strays(runs[SPATIAL])
    claims.append(Claim(f"{CONTACT}: the same over that with half the step", whole / halved, 2.0, 5e-3))
    claims += trajectories.load_claims(runs, 5e-7)

    def draw(fig: "Figure") -> None:
        trajectories.draw(fig, runs)

    return Findings(claims, draw, trajectories.strays_table(runs), (9.5, 3.6), missing=absent(found))
