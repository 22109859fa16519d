"""A controller on the readings of sensors: the estimator as it is exported to C, compiled here, and any law."""

import copy
import ctypes
from collections.abc import Mapping
from types import NoneType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

from ballbot_rs._checks import real_array
from ballbot_rs._core import Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._quaternions import to_vertical
from ballbot_rs.control.resolve import CONTROL_DT, ResolvedController, Source, find
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.deployment.compiled import compiled, pointer
from ballbot_rs.deployment.estimator import estimator_header

Array = npt.NDArray[np.float64]

_SOURCE: Final = """\
int size(void);
void begin(ballbot_estimator *estimator, const ballbot_state *state);
void update(ballbot_estimator *estimator, const double *gyro, const double *force, const double *rates,
            ballbot_state *state);

int size(void)
{
    return (int)sizeof(ballbot_estimator);
}

void begin(ballbot_estimator *estimator, const ballbot_state *state)
{
    ballbot_estimator_begin(estimator, state);
}

void update(ballbot_estimator *estimator, const double *gyro, const double *force, const double *rates,
            ballbot_state *state)
{
    ballbot_estimator_update(estimator, gyro, force, rates, state);
}
"""


class EstimatedController:
    """Any controller on readings of an IMU and encoders, as it runs on a robot: a law that reads sensors.

    The estimator is the C99 of `ballbot export --estimator`, compiled with the C compiler of this computer. It begins
    with the first readings of an episode, at rest at the origin with yaw 0, in the attitude that the accelerometer
    measures. A copy begins a new episode; it shares the compiled estimator and no memory.

    Args:
        controller: a name, or a law or class of laws in Python; a policy observes more than a state.
        params: the robot, the name of a preset, or None for the paper's.
        sensors: as `sensors=` of an environment: the errors that the estimator expects.
        control_dt: time between two calls, s; None is the controller's, else 0.01 s.

    Raises:
        ValueError: a policy, an unknown robot or sensors, or a number out of range.
        OSError: there is no C compiler.
    """

    reads_sensors = True

    def __init__(
        self,
        controller: Source,
        params: Params | str | None = None,
        sensors: Mapping[str, Any] | str = "exact",
        control_dt: float | None = None,
    ) -> None:
        if not isinstance(params, (Params, str, NoneType)):
            raise InvalidInputError(f"params = {params!r}: expected a robot or the name of a preset")
        if not isinstance(sensors, (Mapping, str)):
            raise InvalidInputError(f"sensors = {sensors!r}: expected a name or a table of sensors")
        found = find(controller)
        if found.make_law is None:
            raise InvalidInputError(f"{found.name} is a policy, which observes more than the state of a robot")
        self.name = found.name
        self.control_dt = found.control_dt or CONTROL_DT if control_dt is None else control_dt
        self._robot = params if isinstance(params, Params) else Params.preset(params or "paper")
        self._library = compiled("estimator", estimator_header(self._robot, sensors, self.control_dt), _SOURCE)
        self._memory = ctypes.create_string_buffer(self._library.size())
        self._state = np.zeros(17)
        self._angles: Array | None = None
        self._found = found
        self._laws = found.laws(1, self._robot, self.control_dt)

    def resolved(self) -> ResolvedController:
        """The law as `find` returns it.

        Its `law` raises ValueError for another time between two calls.
        """

        def begin(_: Any, control_dt: float) -> "EstimatedController":
            if control_dt != self.control_dt:
                raise InvalidInputError(
                    f"the estimator of {self.name} is made for control_dt = {self.control_dt:g} s, and it is called "
                    f"every {control_dt:g} s"
                )
            self.reset()
            return self

        return ResolvedController(self.name, make_law=begin, existing=self, control_dt=self.control_dt)

    def __deepcopy__(self, _: Any) -> Self:
        other = copy.copy(self)
        other._memory = ctypes.create_string_buffer(len(self._memory))
        other._state = np.zeros_like(self._state)
        other._angles = None
        other._found = self._found.copied()
        other._laws = other._found.laws(1, self._robot, self.control_dt)
        return other

    def reset(self) -> None:
        """Forgets the episode."""
        self._angles = None
        self._laws.reset()

    def __call__(
        self, readings: Mapping[str, Array], position: Array, velocity: Array, yaw: float, yaw_rate: float
    ) -> Array:
        """Torques for the next control step, shape (3,), N·m; arguments as of `Link`.

        Raises:
            ValueError: readings that are not three finite numbers each, or first readings without an attitude: no
                specific force, or straight down.
        """
        gyro, force, angles = (
            _checked(name, readings.get(name)) for name in ("gyro", "specific_force", "wheel_angles")
        )
        if self._angles is None:
            if np.linalg.norm(force) + force[2] <= 0.0:
                raise InvalidInputError(f"specific_force = {force} m/s²: no attitude at rest follows from it")
            self._state[:] = 0.0
            self._state[:4] = to_vertical(force)
            self._library.begin(self._memory, pointer(self._state))
            self._angles = angles
        rates = (angles - self._angles) / self.control_dt
        self._angles = angles
        self._library.update(self._memory, *map(pointer, (gyro, force, rates, self._state)))
        setpoint = Setpoint(position=position, velocity=velocity, yaw=yaw, yaw_rate=yaw_rate)
        torques: Array = self._laws.torques([self.estimate()], [setpoint])[0]
        return torques

    def estimate(self) -> State:
        """The state after the last readings."""
        # In the order of `ballbot_state`.
        quaternion, rate, position, velocity, ball_rate, wheel_speeds = np.split(self._state, (4, 7, 9, 11, 14))
        return State(
            np.append(position, self._robot.ball_radius),
            np.append(velocity, 0.0),
            ball_rate,
            quaternion,
            rate,
            wheel_speeds,
        )


def _checked(name: str, readings: Any) -> Array:
    """A copy for C."""
    found = np.array(real_array(f"{name} =", readings, "3 finite numbers"), dtype=np.float64)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InvalidInputError(f"{name} = {found}: expected 3 finite numbers")
    return found
