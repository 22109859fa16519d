"""The interface of every engine's robot, and how to make one."""

from typing import Protocol

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array, RobotGeometry, robot_geometry


class AnyRobot(Protocol):
    """One robot in an engine."""

    #: Time step, s.
    sim_dt: float

    def reset(self, state: bb.State) -> None:
        """Restarts from `state`."""

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Attitude (4), body rate (3), wheel speeds (3), ball position and velocity (2 each)."""

    def state(self) -> bb.State:
        """The full state, but slower."""

    def wheel_loads(self) -> Array:
        """Normal forces (3, N)."""

    def close(self) -> None:
        """Frees the engine."""


class ExternalRobot(AnyRobot, Protocol):
    """One robot in another engine, which can be started without a `State`."""

    def reset(self, state: bb.State) -> None:
        """Restarts from `state`, its ball and wheels at zero angles."""
        self.reset_raw(
            state.body_quaternion, state.body_angular_velocity, state.wheel_speeds, state.ball_position,
            state.ball_velocity, state.ball_angular_velocity,
        )  # fmt: skip

    def reset_raw(
        self, attitude: Array, rate: Array, speeds: Array, position: Array, velocity: Array, ball_rate: Array
    ) -> None:
        """Restarts with the body at the ball; arguments as the fields of `ballbot_rs.State`."""


def make_external_robot(engine: str, robot: RobotGeometry | None = None) -> ExternalRobot:
    """One robot in "mujoco" or "pybullet"."""
    robot = robot_geometry() if robot is None else robot
    if engine == "mujoco":
        from ballbot_rs.engines.mujoco_robot import MujocoRobot
        from validation.engines.fast_mujoco import FAST

        return MujocoRobot(robot, FAST)
    from validation.engines.pybullet_robot import PybulletRobot

    return PybulletRobot(robot)
