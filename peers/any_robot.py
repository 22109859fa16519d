"""What every engine's robot can be asked, and how to make one."""

from typing import Protocol

import ballbot_rs as bb
from peers.robot import Array, Robot, make_robot


class AnyRobot(Protocol):
    """One robot in an engine."""

    @property
    def sim_dt(self) -> float:
        """Time step, s."""

    def reset(self, state: bb.State) -> None:
        """Starts anew from `state`."""

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Attitude (4), body rate (3), wheel speeds (3), ball position and velocity (2 each)."""

    def state(self) -> bb.State:
        """All that there is to know, but slower."""

    def wheel_loads(self) -> Array:
        """Normal forces (3, N)."""

    def close(self) -> None:
        """Frees the engine."""


class PeerRobot(AnyRobot, Protocol):
    """One robot in a peer's engine, which can be started without a `State`."""

    def reset_raw(
        self, attitude: Array, rate: Array, speeds: Array, position: Array, velocity: Array, ball_rate: Array
    ) -> None:
        """Starts anew; arguments as the fields of `ballbot_rs.State`."""


def make_peer(engine: str, robot: Robot | None = None) -> PeerRobot:
    """One robot in "mujoco" or "pybullet"."""
    robot = make_robot() if robot is None else robot
    if engine == "mujoco":
        from peers.mujoco_robot import MujocoRobot

        return MujocoRobot(robot)
    from peers.pybullet_robot import PybulletRobot

    return PybulletRobot(robot)
