"""A task other than balance: it samples commands, in whose place a user may give others."""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.control.setpoints import PARTS, Setpoint
from ballbot_rs.envs._batch_env import new_batch, option_names
from ballbot_rs.envs.registration import description_of, geometry_of
from ballbot_rs.viewer.session.drivers import Driver, LawDriver, TaskPolicy, Torques
from ballbot_rs.viewer.session.objective import Call, Objective
from ballbot_rs.viewer.session.recording import Commands
from ballbot_rs.viewer.session.robots import Robots
from ballbot_rs.viewer.session.setup import DECIDED

FloatArray = npt.NDArray[np.float64]

#: Geometries of commands that the page gives: by keys, or by a click on the floor.
DRIVEN, CLICKED = "velocity", "point"

#: Slew rates of a driving command, m/s², as of the point of the task path, and rad/s²: keys may be pressed faster than
#: a robot can follow.
ACCELERATION, YAW_ACCELERATION = 0.6, 2.0

#: The term of the samples with the pushes of a task.
TASK_PUSH = "push:task"

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
        self.driver: Driver
        if controller.policy is None:
            self.driver = self._law = LawDriver(controller, params, num_robots)
            self._policy = None
        else:
            self.driver = self._policy = TaskPolicy(controller, params, task, options)
        own = option_names(task)
        # A law has the options with which the robots were made, possibly of another task.
        given = {**options, **{name: value for name, value in controller.env_options.items() if name in own}}
        self.task_options: Mapping[str, Any] = {name: value for name, value in given.items() if name not in DECIDED}
        on_ground = {**self.task_options, "robot": params, "terrain": options.get("terrain")}
        batch = new_batch(1, task=task, num_threads=1, options=on_ground)
        made = batch.options
        #: Whether a task in Python has its own meaning of clicks.
        self._has_clicks = batch.stage is not None and batch.stage.takes_clicks
        self.takes_clicks = self.geometry == CLICKED or self._has_clicks
        # A wrong drawing is an error here, not while robots move.
        self._draws = batch.stage is not None and batch.stage.drawing() is not None
        #: Largest speed, m/s, and yaw rate, rad/s, that may be commanded: the largest that the task samples.
        bounds = [part["bound"] for part in description_of(task)["command"]] if self.geometry == DRIVEN else [0.0]
        self.max_speed = made.get("speed", made.get("speed_range", bounds[:1])[-1])
        self.max_yaw_rate = made.get("yaw_rate", 0.0)
        #: Largest distance of a goal from the ball, m.
        self.max_distance = made.get("goal_distance", (0.0, MAX_CLICK))[1]
        self._hand: FloatArray | None = None
        #: Present manual commands of the robots; for driving they move towards `_hand`.
        self._given: dict[int, FloatArray] = {}

    def torques(self, robots: Robots, call: Call) -> Torques:
        """As `Objective`. The controller's inputs are read before the call, which may be in another thread."""
        if self.geometry == DRIVEN and self._hand is not None:
            self._give(robots, [self._towards_hand(now) for now in robots.commands])
        if self._policy is not None:
            policy, observations = self._policy, robots.observations
            return call(lambda: policy.torques(observations))
        states: Sequence[Any] = robots.readings if self._law.reads_sensors else robots.seen
        setpoints = [Setpoint(**{part: parts[part] for part in PARTS}) for parts in robots.setpoints]
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
            robots[index].set_command(rest)
            self._given[index] = rest
            if index == 0 and self.geometry == DRIVEN:
                self._hand = rest

    def continue_from(self, robots: Robots, before: Objective) -> None:
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
        fractions = [check_bounded(n, v, -1.0, 1.0) for n, v in zip(names, (forward, left, turn), strict=True)]
        self._check_driven()
        # On the diagonal two keys command more than the task samples.
        speed = self.max_speed / max(1.0, math.hypot(*fractions[:2]))
        self._hand = np.array([speed * fractions[0], speed * fractions[1], self.max_yaw_rate * fractions[2]])

    def command(self, vx: float, vy: float, yaw_rate: float) -> None:
        """Drives all robots: velocity of the ball, heading frame, m/s, and rate of the heading, rad/s.

        Raises:
            ValueError: a number out of range, or another task.
        """
        self._check_driven()
        velocity = [check_bounded(n, v, -self.max_speed, self.max_speed) for n, v in (("vx", vx), ("vy", vy))]
        turn = check_bounded("yaw_rate", yaw_rate, -self.max_yaw_rate, self.max_yaw_rate)
        if math.hypot(*velocity) > (1.0 + 1e-9) * self.max_speed:
            raise ValueError(f"the speed of ({vx}, {vy}) m/s is out of range: expected at most {self.max_speed:g}")
        self._hand = np.array([*velocity, turn])

    def _check_driven(self) -> None:
        if self.geometry != DRIVEN:
            raise ValueError(f"the task {self.task} is not driven: choose the task velocity")

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
        if self._has_clicks:
            for robot in robots:
                robot.click(goal)
            return
        self._hand = goal
        self._give(robots, self._goals(robots))

    def nearest(self, robots: Robots, x: float, y: float) -> tuple[float, float]:
        """As `Objective`, for robot 0."""
        near = self._nearer(np.array([x, y]), robots[0].state.ball_position[:2])
        return float(near[0]), float(near[1])

    @property
    def reach(self) -> str:
        """As `Objective`."""
        return f"the limit is {self.max_distance:.3g} m from the ball"

    def _nearer(self, goal: FloatArray, ball: FloatArray) -> FloatArray:
        way = goal - ball
        nearer: FloatArray = ball + way * min(1.0, self.max_distance / max(float(np.linalg.norm(way)), 1e-9))
        return nearer

    def _goals(self, robots: Robots) -> list[FloatArray]:
        """The manual goal, limited to this distance from each ball."""
        assert self._hand is not None
        return [self._nearer(self._hand, state.ball_position[:2]) for state in robots.states]

    def _give(self, robots: Robots, commands: Sequence[FloatArray]) -> None:
        for index, (now, current) in enumerate(zip(robots.commands, commands, strict=True)):
            # Giving the same command again would restart its error metrics.
            if not np.array_equal(now, current):
                robots[index].set_command(current)
            self._given[index] = current

    def _drawn(self, robots: Robots) -> list[FloatArray]:
        try:
            return [robot.drawing for robot in robots] if self._draws else []
        except Exception as error:  # Whatever a task draws, the robots continue.
            self._draws = False
            warnings.warn(f"the task {self.task} is no longer drawn: {error}", stacklevel=2)
            return []

    def shown(self, robots: Robots) -> dict[str, Any]:
        """As `Objective`: the task's commands."""
        points = np.array([parts["position"] for parts in robots.setpoints])
        begins = np.array([robot.begin for robot in robots])
        pushes = np.array([robot.draws.get(TASK_PUSH, np.full(3, np.nan)) for robot in robots])
        by_hand = self._hand is not None
        drawn = self._drawn(robots)
        commands = Commands(self.task, robots.commands, begins, points, pushes, robots[0].metrics, by_hand, drawn)
        return {"commands": commands}
