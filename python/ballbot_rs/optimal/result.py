"""What an optimization has found."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import keep_copies
from ballbot_rs._core import Params, Reference, State, Terrain
from ballbot_rs.optimal import tangent
from ballbot_rs.optimal.law import TimeVaryingLqr

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class OptimizedTrajectory:
    """A motion from `optimize_trajectory`, with T control steps.

    ```python
    found = bb.optimize_trajectory((0.2, 0.0), seconds=1.4, control_dt=0.02)
    print(bb.simulate(found.law(), seconds=2.0))
    ```

    Its arrays are read-only. It can be pickled.

    `reached` is whether the last state is the goal within 1 mm, 5 mm/s, 2 mrad of lean, 5 mrad of heading, 10 mrad/s,
    20 mrad/s of heading and 0.1 rad/s of the ball's spin, for the paper's robot, and scaled for another.
    """

    params: Params
    terrain: Terrain | None
    #: The reference, made for this robot; None for a motion to a goal.
    reference: Reference | None
    #: s, shape (T + 1,).
    times: Array
    states: Sequence[State]
    #: Wheel torques, which hold from a state to the next, N·m, shape (T, 3).
    torques: Array
    #: Tractions of the wheels as fractions of their loads in the time step before each later state, shape (T, 3);
    #: 0 without load.
    friction_used: Array
    #: Distance of the ball from the goal, or from the reference, m, shape (T + 1,).
    position_errors: Array
    #: Whether the last state is the goal; None with a reference.
    reached: bool | None
    #: Whether the cost reached a local minimum; otherwise the optimizer got stuck or ran out of iterations.
    converged: bool
    iterations: int
    #: Half the sum of (torque / 0.25 N·m)², integrated over time in s, and the goal's or reference's part.
    cost: float
    #: Feedback of the law: torques by the state, in the coordinates of `Jacobian.states`, shape (T, 3, 30).
    gains: Array
    control_dt: float
    sim_dt: float
    max_torque: float

    def __post_init__(self) -> None:
        keep_copies(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Arrays of a copy are read-only, too."""
        vars(self).update(state)
        keep_copies(self)

    def law(self) -> TimeVaryingLqr:
        """The law `tvlqr` that follows the motion: for `simulate(found.law(), start=found.states[0], seconds=...)`."""
        states = np.array([state.to_array() for state in self.states])
        return TimeVaryingLqr(
            states,
            self.torques,
            self.gains,
            robot=self.params,
            terrain=self.terrain,
            control_dt=self.control_dt,
            sim_dt=self.sim_dt,
            max_torque=self.max_torque,
        )

    def __repr__(self) -> str:
        end = {True: ", reached", False: ", not reached", None: ""}[self.reached]
        return (
            f"<OptimizedTrajectory: {self.times[-1]:g} s{end}, {self.iterations} iterations, "
            f"{'converged' if self.converged else 'not converged'}>"
        )


def stretched(found: OptimizedTrajectory, steps: int, control_dt: float) -> Callable[[int, Array], Array]:
    """A motion at another pace: its path with scaled rates, its torques, and its feedback."""
    rows = np.array([state.to_array() for state in found.states])
    count = len(found.torques)
    at = np.arange(steps + 1) * (count / steps)
    before = np.minimum(at.astype(int), count - 1)
    after = (at - before)[:, None]
    rows = rows[before] * (1.0 - after) + rows[before + 1] * after
    for first in (3, 16):
        rows[:, first : first + 4] /= np.linalg.norm(rows[:, first : first + 4], axis=1, keepdims=True)
    for first in (7, 10, 20, 23, 29):
        rows[:, first : first + 3] *= found.times[-1] / (steps * control_dt)

    def law(k: int, row: Array) -> Array:
        step = before[k]
        return np.asarray(found.torques[step] + found.gains[step] @ tangent.difference(row, rows[k]))

    return law
