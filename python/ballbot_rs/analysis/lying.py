"""A robot that has fallen: it lies on the ground without power."""

import contextlib
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Ballbot, Params, State, Terrain

#: How far a robot is lifted, m, until it can lie: in `rigid` it sinks into the ground by a few millimeters on impact.
LIFTS: Final = (0.002, 0.005, 0.01, 0.02, 0.05)


def lying_robot(
    params: Params,
    model: str,
    sim_dt: float,
    terrain: Terrain | None,
    state: State,
    payloads: npt.NDArray[np.float64],
) -> Ballbot | None:
    """A robot that continues from a fall, outside of the environment, whose episode has ended.

    Args:
        params: the robot.
        model: as in `Ballbot`, as `sim_dt` and `terrain`.
        sim_dt: see above.
        terrain: see above.
        state: its state after the fall.
        payloads: deflections of its payloads then, as `Ballbot.payloads`; a rider who leaned sits up.

    Returns:
        None for a state from which it cannot continue.
    """
    robot = Ballbot(params, model, sim_dt, terrain)
    ball, body = state.ball_position, state.body_position
    raised = (np.array([0.0, 0.0, lift]) for lift in LIFTS)
    for lifted in (state, *(state.replace(ball_position=ball + up, body_position=body + up) for up in raised)):
        with contextlib.suppress(ValueError):
            robot.reset(lifted)
            robot.set_payloads(payloads)
            return robot
    return None
