"""What drives the robots of a session: one controller for each robot, chosen by name."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Lqr, Params, Pid, State
from ballbot_rs.control.resolve import PID_CONTROL_DT
from ballbot_rs.viewer.policy import Policy, PolicyDriver, load_onnx

Torques = npt.NDArray[np.float64]

#: Time step of the models, s, unless a policy was trained with another one.
SIM_DT = 0.002
CONTROL_DT = 0.01

#: Controllers by name; any other name is that of a policy file.
CONTROLLERS = ("lqr", "pid", "zero")


class Driver(Protocol):
    """Chooses the wheel torques of all robots of a session."""

    control_dt: float
    sim_dt: float

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m."""

    def reset(self) -> None:
        """Forgets the past."""


class _Feedback:
    """A controller of this package on every robot."""

    sim_dt = SIM_DT

    def __init__(self, controllers: Sequence[Lqr | Pid]) -> None:
        self._controllers = controllers
        self.control_dt = controllers[0].control_dt

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:
        return np.array(
            [controller(state, position=setpoint) for controller, state in zip(self._controllers, states, strict=True)]
        )

    def reset(self) -> None:
        for controller in self._controllers:
            controller.reset()


class _Zero:
    """Motors without current."""

    control_dt = CONTROL_DT
    sim_dt = SIM_DT

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:  # noqa: ARG002
        return np.zeros((len(states), 3))

    def reset(self) -> None:
        pass


def make_driver(name: str, params: Params, num_robots: int, policy: Policy | None = None) -> Driver:
    """The controller of that name, or the policy in the ONNX file of that name, on `num_robots` robots.

    Args:
        name: one of `CONTROLLERS`, or the path of an ONNX file.
        params: the robot.
        num_robots: how many.
        policy: what to use instead of reading the file.

    Raises:
        ValueError: an unknown name, or a file that holds no policy for this robot.
        FileNotFoundError: there is no such file.
        ModuleNotFoundError: ONNX files cannot be read without more packages.
    """
    if name == "lqr":
        return _Feedback([Lqr(params, CONTROL_DT) for _ in range(num_robots)])
    if name == "pid":
        return _Feedback([Pid(params, PID_CONTROL_DT) for _ in range(num_robots)])
    if name == "zero":
        return _Zero()
    return PolicyDriver(load_onnx(name) if policy is None else policy, params, num_robots)
