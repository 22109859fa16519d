"""A feedback gain from elsewhere, such as MATLAB, as a law."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_real, did_you_mean, real_array
from ballbot_rs._core import LinearModel, Lqr, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.resolve import CONTROL_DT, ResolvedController

Array = npt.NDArray[np.float64]

#: Names of the states without their units.
NAMES: Final = tuple(name.partition(" (")[0] for name in LinearModel.STATES)

#: Column of the yaw rate in the deviation.
YAW_RATE: Final = NAMES.index("body rate z")


@named
class StateFeedback:
    """The law τ = −K x of a gain K, usable wherever a law is; `lqr` and `dlqr` of MATLAB return K with this sign.

    x is the deviation from the setpoint in the heading frame, SI units and radians: position error of the ball (x, y),
    tilt (x, y) from the equilibrium about these axes, yaw error, then their rates: the states of `LinearModel`, whose
    `A` and `B` are used to design K. τ are the torques of the wheels 0, 1, 2, N·m. They are limited only by the motors,
    scaled down together; `Lqr` also limits lean, speed and traction. It follows `position`, `velocity`, `yaw` and
    `yaw_rate`.

    ```python
    A, B = bb.LinearModel("kugle").discretize(0.01)  # for K = dlqr(A, B, Q, R), as this one
    K = bb.Lqr("kugle").gain
    print(bb.simulate(bb.StateFeedback(K), robot="kugle", tilt=(0.05, 0.0)))
    ```

    Args:
        gain: K, shape (3, k), N·m per unit of the state.
        states: the state of each column, names of `LinearModel.STATES` with or without unit; states without a column
            have no feedback. None is all ten in the order of `LinearModel.STATES`.
        robot: as in `simulate`, whose equilibrium is zero tilt; None is the robot that it controls.
        control_dt: time between two calls, s, as in the design of K.

    Raises:
        ValueError: another shape, a number that is not finite, an unknown or repeated state, or `control_dt` not above
            0.
        TypeError: a gain that is not numbers.
    """

    name = "state_feedback"

    def __init__(
        self,
        gain: npt.ArrayLike,
        states: Sequence[str] | None = None,
        robot: Robot | None = None,
        *,
        control_dt: float = CONTROL_DT,
    ) -> None:
        columns = _columns(states)
        given = real_array("gain is", gain, "numbers")
        if given.shape != (3, len(columns)):
            raise InvalidInputError(f"gain has shape {given.shape}, expected (3, {len(columns)}): one column per state")
        if not np.isfinite(given).all():
            raise InvalidInputError("gain has numbers that are not finite")
        if not check_real("control_dt", control_dt) > 0.0:
            raise InvalidInputError(f"control_dt = {control_dt} is out of range: it must be above 0")
        #: Time between two calls, s.
        self.control_dt = float(control_dt)
        self._gain = np.zeros((3, len(NAMES)))
        self._gain[:, columns] = given
        self._params = None if robot is None else params_of(robot)

    @property
    def gain(self) -> Array:
        """K (3×10), in the order of `LinearModel.STATES`."""
        gain: Array = self._gain.copy()
        return gain

    def resolved(self) -> ResolvedController:
        """As `control.resolve.Resolvable`."""
        return ResolvedController(
            self.name,
            make_law=lambda params, _: _OnRobot(self._gain, self._params or params),
            control_dt=self.control_dt,
        )

    def __repr__(self) -> str:
        used = [name for name, column in zip(NAMES, self._gain.T, strict=True) if column.any()]
        return f"<StateFeedback on {', '.join(used) or 'nothing'}, control_dt={self.control_dt:g} s>"

    def __call__(
        self,
        state: State | Sequence[State] | Array,
        *,
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
    ) -> Array:
        """Wheel torques, N·m, without a limit; without `robot` for the paper's robot.

        Args:
            state: one, or a row of `State.to_array`; or n of them, as a list or an array, shape (n, 32).
            position: of the setpoint of all states, m.
            velocity: of the setpoint, m/s.
            yaw: of the setpoint, rad.
            yaw_rate: of the setpoint, rad/s.

        Returns:
            Shape (3,), or (n, 3) for n states.
        """
        setpoint: dict[str, Any] = {"position": position, "velocity": velocity, "yaw": yaw, "yaw_rate": yaw_rate}
        if isinstance(state, State):
            return self._law(state, **setpoint)
        if isinstance(state, np.ndarray) and state.ndim == 1:
            return self._law(State.from_array(state), **setpoint)
        states = [one if isinstance(one, State) else State.from_array(one) for one in state]
        return np.array([self._law(one, **setpoint) for one in states]).reshape(-1, 3)

    @functools.cached_property
    def _law(self) -> _OnRobot:
        return _OnRobot(self._gain, self._params or Params.paper())

    def __getstate__(self) -> dict[str, Any]:
        # The law of a robot cannot be pickled, and is made again.
        return {name: value for name, value in vars(self).items() if name != "_law"}


class _OnRobot:
    """The law of one robot."""

    def __init__(self, gain: Array, params: Params) -> None:
        # Only its deviation is used.
        self._gain, self._lqr = gain, Lqr(params)

    def __call__(
        self,
        state: State,
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
    ) -> Array:
        deviation = self._lqr.deviation(state, position=position, velocity=velocity, yaw=yaw).copy()
        deviation[YAW_RATE] -= yaw_rate
        torques: Array = -self._gain @ deviation
        return torques


def _columns(states: Sequence[str] | None) -> list[int]:
    """Numbers of states."""
    if states is None:
        return list(range(len(NAMES)))
    if isinstance(states, str) or not isinstance(states, Iterable):
        raise InvalidInputError(f"states = {states!r}: expected a list of names")
    known: dict[Any, int] = {name: i for i, name in enumerate(NAMES)}
    known |= {name: i for i, name in enumerate(LinearModel.STATES)}
    found = []
    for name in states:
        if name not in known:
            raise InvalidInputError(
                f"unknown state {name!r}: expected one of {', '.join(NAMES)}{did_you_mean(str(name), NAMES)}"
            )
        if known[name] in found:
            raise InvalidInputError(f"the state '{name}' has two columns")
        found.append(known[name])
    return found
