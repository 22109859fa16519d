"""A controller on the readings of sensors: the estimator of the simulation, and any law."""

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

from ballbot_rs._core import Estimator, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.resolve import CONTROL_DT, ResolvedController, Source, find
from ballbot_rs.control.setpoints import Setpoint

Array = npt.NDArray[np.float64]

#: What a link carries.
_MEASURED = ("gyro", "specific_force", "wheel_angles")


@named
class EstimatedController:
    """Any controller fed with readings of an IMU and encoders, as on a real robot: a law that reads sensors.

    ```python
    law = bb.EstimatedController("lqr", "kugle", sensors="kugle")
    print(bb.simulate(law, robot="kugle", sensors="kugle", seconds=2.0))
    ```

    Each episode begins as `Estimator.reset` without a state: at rest at the origin with yaw 0, in the attitude that the
    accelerometer measures. A copy begins a new episode.

    Args:
        controller: a name, or a law or class of laws in Python; a policy observes more than a state.
        robot: as in `simulate`; None is the paper's.
        sensors: as `sensors=` of an environment: the errors that the estimator expects.
        control_dt: time between two calls, s; None is the controller's, else 0.01 s.

    Raises:
        ValueError: a policy, an unknown robot or sensors, or a number out of range.
    """

    reads_sensors = True

    def __init__(
        self,
        controller: Source,
        robot: Robot | None = None,
        sensors: Mapping[str, Any] | str = "exact",
        control_dt: float | None = None,
    ) -> None:
        if not isinstance(sensors, (Mapping, str)):
            raise InvalidInputError(f"sensors = {sensors!r}: expected a name or a table of sensors")
        found = find(controller)
        if found.make_law is None:
            raise InvalidInputError(f"{found.name} is a policy, which observes more than the state of a robot")
        self.name = found.name
        self.control_dt = found.control_dt or CONTROL_DT if control_dt is None else control_dt
        self._robot = params_of(robot)
        self._estimator = Estimator(self._robot, sensors, self.control_dt)
        self._found = found
        self._laws = found.laws(1, self._robot, self.control_dt)

    def resolved(self) -> ResolvedController:
        """The law as `find` returns it.

        Its `law` raises ValueError for another time between two calls.
        """

        def begin(_: Any, control_dt: float) -> "EstimatedController":
            if control_dt != self.control_dt:
                raise InvalidInputError(
                    f"the estimator of {self.name} is made for control_dt = {self.control_dt:g} s, but it is called "
                    f"every {control_dt:g} s"
                )
            self.reset()
            return self

        return ResolvedController(self.name, make_law=begin, existing=self, control_dt=self.control_dt)

    def __deepcopy__(self, _: Any) -> Self:
        other = copy.copy(self)
        other._estimator = copy.copy(self._estimator)
        other._estimator.reset()
        other._found = self._found.copied()
        other._laws = other._found.laws(1, self._robot, self.control_dt)
        return other

    def reset(self) -> None:
        """Forgets the episode."""
        self._estimator.reset()
        self._laws.reset()

    def __call__(self, readings: Mapping[str, Array], setpoint: Setpoint) -> Array:
        """Torques for the next control step, shape (3,), N·m.

        Raises:
            ValueError: as `Estimator.update`.
        """
        state = self._estimator.update({name: readings[name] for name in _MEASURED if name in readings})
        torques: Array = self._laws.torques([state], [setpoint])[0]
        return torques

    def estimate(self) -> State:
        """The state after the last readings."""
        return self._estimator.state
