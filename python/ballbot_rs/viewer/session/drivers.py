"""Drivers: a controller on every robot of a session."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import SCALED_BOUND, TASKS, Params, State
from ballbot_rs.control.observed_integral import ObservedIntegral
from ballbot_rs.control.recurrent import PolicyMemory
from ballbot_rs.control.reference import largest_lead
from ballbot_rs.control.resolve import CONTROL_DT, NAMES, ResolvedController, find
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.envs.spaces import history_ages

Torques = npt.NDArray[np.float64]

#: Time step of the models, s; policies have the steps of their training.
SIM_DT = 0.002

#: Range of the time between two calls of a controller, s, and most time steps of a model in it.
MIN_CONTROL_DT, MAX_CONTROL_DT = 1e-3, 1.0
MAX_SUBSTEPS = 1000

#: How far a robot is raised for its observation, m; its height is not observed.
LIFT = 1.0


class Driver(Protocol):
    """A controller on every robot of a session."""

    control_dt: float
    sim_dt: float
    #: Largest torque that it may choose, N·m: the motors' limit, or a policy's torque at an action of 1.
    max_torque: float
    #: Whether it contains foreign code, which may never return.
    is_foreign: bool
    #: Whether it takes readings of sensors in place of states.
    reads_sensors: bool

    def reset(self, robot: int | None = None) -> None:
        """Clears the memory of past steps, of all robots or of one."""


class BalancingDriver(Driver, Protocol):
    """Chooses the wheel torques of all robots of a session that balance."""

    #: Whether it moves the robot to a position.
    follows_position: bool

    def torques(self, states: Sequence[Any], setpoints: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        `setpoints` are positions of the ball, m: one per robot, shape (n, 2), or one for all, shape (2,).
        """


def make_driver(controller: ResolvedController, params: Params, num_robots: int) -> BalancingDriver:
    """A controller on `num_robots` robots.

    Raises:
        ValueError: a policy that does not fit this robot, or time steps out of range.
    """
    if controller.policy is None:
        return LawDriver(controller, params, num_robots)
    return PolicyDriver(controller, params, num_robots)


def check_steps(name: str, control_dt: float, sim_dt: float) -> None:
    """Raises ValueError for time steps too short for real time."""
    if not MIN_CONTROL_DT <= control_dt <= MAX_CONTROL_DT:
        limits = f"{MIN_CONTROL_DT:g} to {MAX_CONTROL_DT:g} s"
        raise ValueError(f"{name} has control_dt = {control_dt}, which is out of range: expected {limits}")
    if control_dt > 1.001 * MAX_SUBSTEPS * sim_dt:
        raise ValueError(
            f"{name} has {control_dt / sim_dt:g} time steps of sim_dt = {sim_dt} in control_dt = {control_dt}: "
            f"expected at most {MAX_SUBSTEPS}"
        )


class LawDriver:
    """A feedback law on every robot."""

    def __init__(self, controller: ResolvedController, params: Params, num_robots: int) -> None:
        self.control_dt = CONTROL_DT if controller.control_dt is None else controller.control_dt
        check_steps(controller.name, self.control_dt, SIM_DT)
        # At most the usual time step, and a whole fraction of the controller's period.
        self.sim_dt = self.control_dt / math.ceil(self.control_dt / SIM_DT - 1e-9)
        self.max_torque = params.max_wheel_torque
        self.is_foreign = controller.name not in NAMES
        self._laws = controller.laws(num_robots, params, self.control_dt)
        self.follows_position = "position" in self._laws.follows
        self.reads_sensors = self._laws.reads_sensors
        self._num_robots = num_robots

    def torques(self, states: Sequence[Any], setpoints: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m."""
        return self.follow(states, [Setpoint(position=place) for place in _one_each(setpoints, states)])

    def follow(self, states: Sequence[Any], setpoints: Sequence[Setpoint]) -> Torques:
        """The same for setpoints with all parts, one per robot."""
        return self._laws.torques(states, setpoints)

    def reset(self, robot: int | None = None) -> None:
        """Clears the memory of the laws, or of the law of one robot."""
        self._laws.reset(None if robot is None else np.arange(self._num_robots) == robot)


class PolicyDriver:
    """A policy on every robot.

    The balance task itself makes the observations: each robot's state is put into an environment of the task, moved so
    that the setpoint is at the origin, and raised, so that a ball that events have shrunk is not in the floor. The last
    action, which is not in the state, is the policy's own last choice.
    """

    def __init__(self, controller: ResolvedController, params: Params, num_robots: int) -> None:
        assert controller.policy is not None
        self.follows_position = self.is_foreign = True
        self.reads_sensors = False
        self._memories = [PolicyMemory(controller.policy) for _ in range(num_robots)]
        # All models observe a state alike, with any motors; `contact` accepts every state, even fallen or slipping.
        fixed = {"robot": params, "model": "contact", "actuators": None, "events": None, "setpoint": (0.0, 0.0)}
        fixed |= {"sensors": None, "observation": "ground_truth", "history": 1}
        options = {**controller.env_options, **fixed}
        past = {"history": controller.env_options.get("history", 1)}
        whole = new_batch(1, num_threads=1, options={**options, **past})
        self._ages = history_ages(whole.history)
        # Each observation begins an episode of its environment, where an integral would be zero.
        self._integrals = [ObservedIntegral(whole) for _ in range(num_robots)]
        options["integral_rate"] = 0.0
        self._past: list[list[npt.NDArray[np.float32]]] = [[] for _ in range(num_robots)]
        self._observers = [new_batch(1, num_threads=1, options=options) for _ in range(num_robots)]
        self.control_dt = self._observers[0].control_dt
        self.sim_dt = self._observers[0].sim_dt
        check_steps(controller.name, self.control_dt, self.sim_dt)
        self.max_torque = self._observers[0].max_wheel_torque
        self._last = np.zeros((num_robots, 3), dtype=np.float32)
        rows = TASKS[DEFAULT_TASK]["observation"]
        self._last_rows = [i for i, row in enumerate(rows) if row["name"].startswith("last action")]
        is_scaled = self._observers[0].scale_observations
        self._last_scale = np.array([rows[i]["typical"] if is_scaled else 1.0 for i in self._last_rows])

    def torques(self, states: Sequence[State], setpoints: npt.ArrayLike) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        Raises:
            ValueError: the policy's actions are not three finite numbers.
        """
        for i, (state, place) in enumerate(zip(states, _one_each(setpoints, states), strict=True)):
            observation = self.observe(i, state, place)
            action = np.zeros(3)
            if observation is not None:
                self._integrals[i].add(observation)
                rows = self._with_past(i, observation)
                action = np.squeeze(np.asarray(self._memories[i].act(rows[np.newaxis])), axis=0)
            if action.shape != (3,) or not np.isfinite(action).all():
                raise ValueError(f"the policy chose {action}: expected three finite numbers")
            self._last[i] = np.clip(action, -1.0, 1.0)
        return self._last.astype(np.float64) * self.max_torque

    def observe(self, index: int, state: State, setpoint: npt.ArrayLike) -> npt.NDArray[np.float32] | None:
        """The observation of robot `index`, shape (m,); None if it is in the floor, as no-slip models can be."""
        away = np.append(np.asarray(setpoint, dtype=np.float64), -LIFT)
        start = state.replace(ball_position=state.ball_position - away, body_position=state.body_position - away)
        try:
            observation: npt.NDArray[np.float32] = self._observers[index].reset(starts=[start])[0]
        except ValueError:
            return None
        observation[self._last_rows] = np.clip(self._last[index] / self._last_scale, -SCALED_BOUND, SCALED_BOUND)
        return observation

    def _with_past(self, index: int, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """The last observations of a robot, as with the option `history`."""
        past = self._past[index] = [*self._past[index], observation][-1 - self._ages[-1] :]
        return np.concatenate([past[max(-1 - age, -len(past))] for age in reversed(self._ages)])

    def reset(self, robot: int | None = None) -> None:
        """Clears the last actions and observations, and the policy's state, of all robots or of one."""
        self._last[slice(None) if robot is None else robot] = 0.0
        for i in range(len(self._past)) if robot is None else (robot,):
            self._past[i] = []
            self._integrals[i].reset()
            self._memories[i].reset()


def lead_of(controller: ResolvedController, params: Params) -> float:
    """Largest distance of a controller's target from the ball, m, at which no wheel is close to slipping.

    A controller that reads sensors has a state of the robot only while it drives it: for it the distance is for `lqr`.
    """
    driver = make_driver(controller, params, 1)
    if driver.reads_sensors:
        driver = make_driver(find("lqr"), params, 1)
    # The torque at which no wheel of the upright robot slips, within the motors' limit.
    limit = new_batch(1, num_threads=1, options={"robot": params}).max_wheel_torque
    rest = [State.at_equilibrium(params)]

    def torques(target: npt.NDArray[np.float64]) -> Torques:
        driver.reset()
        return driver.torques(rest, target)

    return largest_lead(torques, limit)


def _one_each(setpoints: npt.ArrayLike, states: Sequence[State]) -> npt.NDArray[np.float64]:
    return np.broadcast_to(np.asarray(setpoints, dtype=np.float64), (len(states), 2))


class TaskPolicy:
    """A policy on robots in environments of its task, which make its observations.

    Raises:
        ValueError: time steps out of range.
    """

    def __init__(self, controller: ResolvedController, params: Params, task: str, options: Mapping[str, Any]) -> None:
        assert controller.policy is not None
        self.is_foreign = True
        self.reads_sensors = False
        self._memory = PolicyMemory(controller.policy)
        self._count = 0
        # The given ground is made already, which takes longest.
        trained = {**controller.env_options, "robot": params, "terrain": options.get("terrain")}
        batch = new_batch(1, task=task, num_threads=1, options=trained)
        self.control_dt, self.sim_dt, self.max_torque = batch.control_dt, batch.sim_dt, batch.max_wheel_torque
        check_steps(controller.name, self.control_dt, self.sim_dt)

    def torques(self, observations: npt.NDArray[np.float32]) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        Raises:
            ValueError: the policy's actions are not three finite numbers each.
        """
        if len(observations) != self._count:
            self._memory.reset()
            self._count = len(observations)
        actions = np.asarray(self._memory.act(observations), dtype=np.float64)
        if actions.shape != (len(observations), 3) or not np.isfinite(actions).all():
            raise ValueError(f"the policy chose {actions}: expected three finite numbers for each robot")
        return np.clip(actions, -1.0, 1.0) * self.max_torque

    def reset(self, robot: int | None = None) -> None:
        """Clears the policy's state; the environments keep the other memory of a robot."""
        self._memory.reset(None if robot is None else np.arange(self._count) == robot)
