"""Numbers that summarize a trajectory, until the robot fell."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ballbot_rs import _short
from ballbot_rs._state_rows import BALL_POSITION, tilt_of

if TYPE_CHECKING:
    from ballbot_rs.analysis.trajectory import Trajectory


@dataclasses.dataclass(frozen=True, repr=False)
class Metrics:
    """Performance of a controller on one trajectory, until the robot fell.

    ```python
    metrics = bb.simulate("lqr", tilt=(0.05, 0.0), seconds=3.0).metrics()
    print(metrics.tilt_rms, metrics.position_error_max)
    ```
    """

    #: Tilt from the equilibrium, rad.
    tilt_rms: float
    tilt_max: float
    #: Horizontal distance of the ball from the position of the setpoint, m; NaN without one, as in a recording of the
    #: page in tasks other than balance.
    position_error_rms: float
    position_error_max: float
    position_error_final: float
    #: Commanded wheel torques, N·m.
    torque_rms: float
    torque_max: float
    #: Largest fraction of the dynamic friction limit that a wheel used.
    traction_utilization_max: float

    def __repr__(self) -> str:
        return _short.fields(self)

    def _repr_html_(self) -> str:
        from ballbot_rs.media.notebook import table_of

        return table_of(self)


def metrics(trajectory: Trajectory) -> Metrics:
    """The numbers of a trajectory."""
    end = len(trajectory.times)
    if trajectory.fell_at is not None:
        end = min(int(np.searchsorted(trajectory.times, trajectory.fell_at - 1e-9)) + 1, end)
    states = trajectory.to_array()[:end]
    tilts = tilt_of(states, trajectory.params.body_com)
    places = trajectory.setpoints.get("position", np.full((end, 2), np.nan))
    errors = np.linalg.norm(states[:, BALL_POSITION][:, :2] - places[:end], axis=1)
    # The last row repeats the torques of the row before.
    torques = trajectory.torques[: max(end - 1, 1)]
    utilization = trajectory.of_contacts("friction_utilization")[:end, :3]
    return Metrics(
        tilt_rms=_rms(tilts),
        tilt_max=float(tilts.max()),
        position_error_rms=_rms(errors),
        position_error_max=float(errors.max()),
        position_error_final=float(errors[-1]),
        torque_rms=_rms(torques),
        torque_max=float(np.abs(torques).max()),
        traction_utilization_max=float(utilization.max()),
    )


def _rms(values: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
