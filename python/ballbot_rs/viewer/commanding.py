"""A task with its own commands: robots in its environments, with commands that it samples or that a user gives."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import TASKS, Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.control.setpoints import PARTS, Setpoint
from ballbot_rs.envs._batch_env import new_batch, option_names
from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.viewer.asked import Asked
from ballbot_rs.viewer.bounds import check_bounded
from ballbot_rs.viewer.drivers import Driver, LawDriver, Torques, check_steps
from ballbot_rs.viewer.objective import Call, Objective
from ballbot_rs.viewer.robots import Robots
from ballbot_rs.viewer.setup import DECIDED

FloatArray = npt.NDArray[np.float64]

#: Geometries of commands that the page gives: by keys, or by a click on the floor.
DRIVEN, CLICKED = "velocity", "point"

#: Slew rates of a driving command, m/s², as of the point of the task path, and rad/s²: keys may be pressed faster than
#: a robot can follow.
ACCELERATION, YAW_ACCELERATION = 0.6, 2.0

#: Largest coordinate of a click, m; the goal is nearer.
MAX_CLICK = 1e3


class Commanding:
    """The objective of a task other than balance.

    Args:
        controller: a policy that was trained in the task, or a law, which follows the task's setpoint.
        params: the robot.
        num_robots: number of robots.
        task: name of the task.
        options: of the task, overridden by the options of a policy's training; `terrain` is made already.

    Raises:
        ValueError: a number out of range, or time steps out of range.
        TypeError: the task has no such option.
    """

    def __init__(
        self, controller: ResolvedController, params: Params, num_robots: int, task: str, options: Mapping[str, Any]
    ) -> None:
        self.task, self.geometry = task, geometry_of(task)
        self.takes_clicks = self.geometry == CLICKED
        self.driver: Driver
        if controller.policy is None:
            self.driver = self._law = LawDriver(controller, params, num_robots)
            self._policy = None
        else:
            self.driver = self._policy = TaskPolicy(controller, params, task, options)
        own = option_names(task)
        # A law has the options with which the robots were made, possibly of another task.
        given = {**options, **{name: value for name, value in controller.env_options.items() if name in own}}
        #: Options of a `Setup`.
        self.task_options = {name: value for name, value in given.items() if name not in DECIDED}
        drawn = new_batch(1, task=task, num_threads=1, options=_on(options, self.task_options, params)).options
        #: Largest speed, m/s, and yaw rate, rad/s, that may be commanded: the largest that the task samples.
        bounds = [part["bound"] for part in TASKS[task]["command"]] if self.geometry == DRIVEN else [0.0]
        self.max_speed = drawn.get("speed", drawn.get("speed_range", bounds[:1])[-1])
        self.max_yaw_rate = drawn.get("yaw_rate", 0.0)
        #: Largest distance of a goal from the ball, m.
        self.max_distance = drawn.get("goal_distance", (0.0, MAX_CLICK))[1]
        self._hand: FloatArray | None = None
        #: Present manual commands of the robots; for driving they move towards `_hand`.
        self._given: dict[int, FloatArray] = {}

    @property
    def by_hand(self) -> bool:
        """Whether the command came from the page."""
        return self._hand is not None

    def torques(self, robots: Robots, call: Call) -> Torques:
        """As `Objective`. The controller's inputs are read before the call, which may be in another thread."""
        if self.geometry == DRIVEN and self._hand is not None:
            self._give(robots, [self._towards_hand(now) for now in robots.commands])
        if self._policy is not None:
            policy, observations = self._policy, robots.observations
            return call(lambda: policy.torques(observations))
        states = robots.seen
        setpoints = [Setpoint(**{part: asked[part] for part in PARTS}) for asked in robots.setpoints]
        return call(lambda: self._law.follow(states, setpoints))

    def reset(self) -> None:
        """As `Objective`: the task samples the commands again."""
        self.driver.reset()
        self._hand = None
        self._given = {}

    def restarted(self, robots: Robots, index: int) -> None:
        """As `Objective`; a robot that is commanded by hand rests at its start."""
        self.driver.reset(index)
        if self._hand is not None:
            rest = np.zeros_like(self._hand)
            robots.set_command(index, rest)
            self._given[index] = rest
            if index == 0 and self.geometry == DRIVEN:
                self._hand = rest

    def go_on(self, robots: Robots, before: Objective) -> None:
        """As `Objective`."""
        if isinstance(before, Commanding) and before.task == self.task and before._hand is not None:
            # A driving command continues from its present value: a jump topples the robot.
            self._hand, given = before._hand, dict(before._given)
            self._give(robots, [given.get(i, now) for i, now in enumerate(robots.commands)])

    def drive(self, forward: float, left: float, turn: float) -> None:
        """Drives all robots: fractions of the largest speed, heading frame, and of the largest yaw rate, in [-1, 1].

        Their commands change gradually to these values.

        Raises:
            ValueError: a number out of range, or another task.
        """
        names = ("forward", "left", "turn")
        shares = [check_bounded(n, v, -1.0, 1.0) for n, v in zip(names, (forward, left, turn), strict=True)]
        if self.geometry != DRIVEN:
            raise ValueError(f"the task {self.task} is not driven: choose the task velocity")
        # On the diagonal two keys command more than the task samples.
        speed = self.max_speed / max(1.0, math.hypot(*shares[:2]))
        self._hand = np.array([speed * shares[0], speed * shares[1], self.max_yaw_rate * shares[2]])

    def _towards_hand(self, now: FloatArray) -> FloatArray:
        """The command of a robot one control step later, moving towards the manual command."""
        assert self._hand is not None
        change = self._hand - now
        speed, turn = math.hypot(*change[:2]), abs(change[2])
        dt = self.driver.control_dt
        change[:2] *= min(1.0, ACCELERATION * dt / max(speed, 1e-12))
        change[2] *= min(1.0, YAW_ACCELERATION * dt / max(turn, 1e-12))
        arrived = speed <= ACCELERATION * dt and turn <= YAW_ACCELERATION * dt
        return self._hand if arrived else now + change

    def click(self, robots: Robots, x: float, y: float) -> None:
        """As `Objective`: the goal, limited to the distance from the ball at which the task samples goals."""
        goal = np.array([check_bounded(n, v, -MAX_CLICK, MAX_CLICK) for n, v in (("x", x), ("y", y))])
        if not self.takes_clicks:
            raise ValueError(f"a click is not a command of the task {self.task}")
        self._hand = goal
        self._give(robots, self._goals(robots))

    def _goals(self, robots: Robots) -> list[FloatArray]:
        """The manual goal, limited to this distance from each ball."""
        assert self._hand is not None
        goals = []
        for state in robots.states:
            ball = state.ball_position[:2]
            way = self._hand - ball
            goals.append(ball + way * min(1.0, self.max_distance / max(float(np.linalg.norm(way)), 1e-9)))
        return goals

    def _give(self, robots: Robots, commands: Sequence[FloatArray]) -> None:
        for index, (now, wanted) in enumerate(zip(robots.commands, commands, strict=True)):
            # Giving the same command again would restart its error metrics.
            if not np.array_equal(now, wanted):
                robots.set_command(index, wanted)
            self._given[index] = wanted

    def shown(self, robots: Robots) -> dict[str, Any]:
        """As `Objective`: the task's commands."""
        points = np.array([asked["position"] for asked in robots.setpoints])
        asked = Asked(
            self.task, robots.commands, robots.begins, points, robots.task_pushes, robots.metrics, self.by_hand
        )
        return {"asked": asked}


def _on(given: Mapping[str, Any], options: Mapping[str, Any], params: Params) -> dict[str, Any]:
    """Options of a robot on the given ground, whose construction takes longest."""
    return {**options, "params": params, "terrain": given.get("terrain")}


class TaskPolicy:
    """A policy on robots in environments of its task, which make its observations.

    Raises:
        ValueError: time steps out of range.
    """

    def __init__(self, controller: ResolvedController, params: Params, task: str, options: Mapping[str, Any]) -> None:
        assert controller.policy is not None
        self.is_foreign = True
        self._policy = controller.policy
        trained = _on(options, controller.env_options, params)
        batch = new_batch(1, task=task, num_threads=1, options=trained)
        self.control_dt, self.sim_dt, self.max_torque = batch.control_dt, batch.sim_dt, batch.max_wheel_torque
        check_steps(controller.name, self.control_dt, self.sim_dt)

    def torques(self, observations: npt.NDArray[np.float32]) -> Torques:
        """Wheel torques for the next `control_dt`, shape (n, 3), N·m.

        Raises:
            ValueError: the policy's actions are not three finite numbers each.
        """
        actions = np.asarray(self._policy(observations), dtype=np.float64)
        if actions.shape != (len(observations), 3) or not np.isfinite(actions).all():
            raise ValueError(f"the policy chose {actions}: expected three finite numbers for each robot")
        return np.clip(actions, -1.0, 1.0) * self.max_torque

    def reset(self, robot: int | None = None) -> None:
        """The environments keep the memory of a robot, not the policy."""
