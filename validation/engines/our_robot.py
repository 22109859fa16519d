"""A `ballbot_rs.Ballbot` with the interface of `AnyRobot`."""

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array
from validation.engines.steps import SIM_DT


class OurRobot:
    """One robot in one of our models."""

    def __init__(self, model: str, params: bb.Params | None = None, sim_dt: float = SIM_DT) -> None:
        self._robot = bb.Ballbot(params, model=model, sim_dt=sim_dt)
        self.sim_dt = sim_dt

    def reset(self, state: bb.State) -> None:
        """Restarts from `state`."""
        self._robot.reset(state)

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""
        self._robot.step(torques, steps=steps)

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Attitude (4), body rate (3), wheel speeds (3), ball position and velocity (2 each)."""
        s = self._robot.state
        rates = (s.body_angular_velocity, s.wheel_speeds)
        return s.body_quaternion, *rates, s.ball_position[:2], s.ball_velocity[:2]

    def state(self) -> bb.State:
        """The present state."""
        return self._robot.state

    def wheel_loads(self) -> Array:
        """Normal forces (3, N)."""
        return np.asarray(self._robot.contacts.wheel_normal_forces)

    def close(self) -> None:
        """Nothing to close."""
