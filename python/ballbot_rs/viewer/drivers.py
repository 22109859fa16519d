"""Drivers: a controller on every robot of a session."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import SCALED_BOUND, TASKS, Params, State
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.registration import DEFAULT_TASK

Torques = npt.NDArray[np.float64]

#: Time step of the models and of controllers without a rate of their own, s; policies have those of their training.
SIM_DT = 0.002
CONTROL_DT = 0.01


class Driver(Protocol):
    """Chooses the wheel torques of all robots of a session."""

    control_dt: float
    sim_dt: float

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m."""

    def reset(self) -> None:
        """Clears the memory of past steps."""


def make_driver(controller: ResolvedController, params: Params, num_robots: int) -> Driver:
    """A controller on `num_robots` robots.

    Raises:
        ValueError: a policy that does not fit this robot.
    """
    if controller.policy is None:
        return LawDriver(controller, params, num_robots)
    return PolicyDriver(controller, params, num_robots)


class LawDriver:
    """A feedback law on every robot."""

    sim_dt = SIM_DT

    def __init__(self, controller: ResolvedController, params: Params, num_robots: int) -> None:
        self.control_dt = controller.control_dt or CONTROL_DT
        self._made_of = (controller, num_robots, params)
        self.reset()

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m."""
        return np.array([law(state, setpoint) for law, state in zip(self._laws, states, strict=True)], dtype=np.float64)

    def reset(self) -> None:
        """Makes the laws anew."""
        controller, num_robots, params = self._made_of
        self._laws = controller.laws(num_robots, params, self.control_dt)


class PolicyDriver:
    """A policy on every robot.

    The balance task itself makes the observations: each robot's state is put into an environment of the task, moved so
    that the setpoint is at the origin. The last action, which a state does not have, is the one the policy chose.
    """

    def __init__(self, controller: ResolvedController, params: Params, num_robots: int) -> None:
        assert controller.policy is not None
        self._policy = controller.policy
        # Any model observes a state alike; `contact` takes every state, be it fallen or slipping.
        options = {**controller.env_options, "params": params, "model": "contact", "setpoint": (0.0, 0.0)}
        self._observers = [new_batch(1, num_threads=1, options=options) for _ in range(num_robots)]
        self.control_dt = self._observers[0].control_dt
        self.sim_dt = self._observers[0].sim_dt
        self._max_torque = self._observers[0].max_wheel_torque
        self._last = np.zeros((num_robots, 3), dtype=np.float32)
        rows = TASKS[DEFAULT_TASK]["observation"]
        self._last_rows = [i for i, row in enumerate(rows) if row["name"].startswith("last action")]
        is_scaled = self._observers[0].scale_observations
        self._last_scale = np.array([rows[i]["typical"] if is_scaled else 1.0 for i in self._last_rows])

    def torques(self, states: Sequence[State], setpoint: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        Raises:
            ValueError: the policy's actions are not three finite numbers.
        """
        for i, state in enumerate(states):
            observation = self.observe(i, state, setpoint)
            action = np.zeros(3)
            if observation is not None:
                action = np.squeeze(np.asarray(self._policy(observation[np.newaxis])), axis=0)
            if action.shape != (3,) or not np.isfinite(action).all():
                raise ValueError(f"the policy chose {action}: expected three finite numbers")
            self._last[i] = np.clip(action, -1.0, 1.0)
        return self._last.astype(np.float64) * self._max_torque

    def observe(self, index: int, state: State, setpoint: npt.ArrayLike) -> npt.NDArray[np.float32] | None:
        """The observation of robot `index`, shape (m,); None if it is in the floor, as no-slip models can be."""
        away = np.append(np.asarray(setpoint, dtype=np.float64), 0.0)
        start = state.replace(ball_position=state.ball_position - away, body_position=state.body_position - away)
        try:
            observation: npt.NDArray[np.float32] = self._observers[index].reset(starts=[start])[0]
        except ValueError:
            return None
        observation[self._last_rows] = np.clip(self._last[index] / self._last_scale, -SCALED_BOUND, SCALED_BOUND)
        return observation

    def reset(self) -> None:
        """Clears the last actions."""
        self._last[:] = 0.0
