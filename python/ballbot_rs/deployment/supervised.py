"""Any controller under the supervisor as it is exported to C, compiled here."""

import copy
import ctypes
import inspect
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import check_keywords, named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.resolve import CONTROL_DT, Source, find
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.deployment.compiled import compiled, pointer
from ballbot_rs.deployment.supervisor import supervisor_header

Array = npt.NDArray[np.float64]

#: In the order of the C.
STATUSES: Final = ("off", "running", "torque", "heat", "held", "tilt", "speed", "stale", "not_finite")

_SOURCE: Final = """\
int size(void);
void reset(ballbot_supervisor *supervisor);
int supervise(ballbot_supervisor *supervisor, const ballbot_state *state, int fresh, double *torques);
void inspect(const ballbot_supervisor *supervisor, double *numbers);

int size(void)
{
    return (int)sizeof(ballbot_supervisor);
}

void reset(ballbot_supervisor *supervisor)
{
    ballbot_supervisor_reset(supervisor);
}

int supervise(ballbot_supervisor *supervisor, const ballbot_state *state, int fresh, double *torques)
{
    return ballbot_supervise(supervisor, state, fresh, torques);
}

void inspect(const ballbot_supervisor *supervisor, double *numbers)
{
    int i;
    for (i = 0; i < 3; i++) {
        numbers[i] = supervisor->heat[i];
    }
    numbers[3] = supervisor->share;
}
"""


@named
class Supervised:
    """Any controller kept within the limits of a robot, as on the robot itself: usable wherever a law is.

    ```python
    law = bb.Supervised("lqr", "kugle", actuators="kugle")
    print(bb.simulate(law, robot="kugle", actuators="kugle", seconds=1.0))
    ```

    The supervisor is the C99 of `ballbot export --supervisor`, compiled with the C compiler of this computer. Readings
    that are not finite do not reach the controller.

    Args:
        controller: a name, or a law or class of laws in Python. A law that reads sensors has `estimate()`, the `State`
            that is supervised, as `EstimatedController`.
        robot: as in `simulate`; None is the paper's.
        control_dt: time between two calls, s; None is the controller's, else 0.01 s.
        limits: as in `supervisor_header`.

    Raises:
        ValueError: a policy, a law that reads sensors without an estimate, or a number out of range.
        TypeError: an unknown limit.
        OSError: there is no C compiler.
    """

    def __init__(
        self, controller: Source, robot: Robot | None = None, control_dt: float | None = None, **limits: Any
    ) -> None:
        found = find(controller)
        if found.make_law is None:
            raise InvalidInputError(f"{found.name} is a policy, which observes more than the state of a robot")
        self.name = found.name
        self.control_dt = found.control_dt or CONTROL_DT if control_dt is None else control_dt
        self._given = controller, robot, control_dt, limits
        robot = params_of(robot)
        known = [*inspect.signature(supervisor_header).parameters][2:]
        check_keywords("Supervised", limits, known)
        self._library = compiled("supervisor", supervisor_header(robot, self.control_dt, **limits), _SOURCE)
        self._laws = found.laws(1, robot, self.control_dt)
        self.reads_sensors = self._laws.reads_sensors
        if self.reads_sensors and not hasattr(self._law, "estimate"):
            raise InvalidInputError(f"{self.name} reads sensors and has no estimate() of the state to supervise")
        #: Whether there are readings in the next step; set it to False for a step in which they are missing.
        self.fresh = True
        self.reset()

    def __deepcopy__(self, memo: dict[int, Any]) -> "Supervised":
        controller, robot, control_dt, limits = self._given
        return type(self)(copy.deepcopy(controller, memo), robot, control_dt, **limits)

    @property
    def heat(self) -> Array:
        """Heat of each motor, 1 at its limit, shape (3,)."""
        return self._inspect()[:3]

    @property
    def share(self) -> float:
        """Fraction of the torques that remains: 1 until a trip, then falling to 0."""
        return float(self._inspect()[3])

    def reset(self) -> None:
        """Begins an episode, with cold motors."""
        self._memory = ctypes.create_string_buffer(self._library.size())
        self._library.reset(self._memory)
        self._laws.reset()
        self._row = np.append(1.0, np.zeros(16))
        self._step = 0
        #: Of the last step: one of `STATUSES`.
        self.status = "running"
        #: Steps by status.
        self.counts: dict[str, int] = {}
        #: Changes of the status: time, s, and the new status.
        self.log: list[tuple[float, str]] = []

    def __call__(self, state: State | Mapping[str, Array], setpoint: Setpoint) -> Array:
        """Torques for the next control step, shape (3,), N·m; `state` is the readings of a law that reads sensors."""
        fresh, self.fresh = self.fresh, True
        torques = np.full(3, np.nan) if fresh else np.zeros(3)
        if fresh and (not isinstance(state, Mapping) or all(np.isfinite(value).all() for value in state.values())):
            torques = np.ascontiguousarray(self._laws.desired([state], [setpoint])[0])
            self._row = _row(self._law.estimate() if self.reads_sensors else state)
        code = self._library.supervise(self._memory, pointer(self._row), int(fresh), pointer(torques))
        self._note(STATUSES[code])
        return torques

    @property
    def _law(self) -> Any:
        return self._laws.first

    def _inspect(self) -> Array:
        numbers = np.zeros(4)
        self._library.inspect(self._memory, pointer(numbers))
        return numbers

    def _note(self, status: str) -> None:
        if status != self.status:
            self.log.append((self._step * self.control_dt, status))
        self.status = status
        self.counts[status] = self.counts.get(status, 0) + 1
        self._step += 1


def _row(state: Any) -> Array:
    """A state in the order of `ballbot_state`."""
    parts = (state.body_quaternion, state.body_angular_velocity, state.ball_position[:2], state.ball_velocity[:2])
    return np.concatenate((*parts, state.ball_angular_velocity, state.wheel_speeds))
