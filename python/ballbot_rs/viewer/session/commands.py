"""The commands of a session's robots, and the torques that follow from them.

In the task balance a user moves a setpoint; another task has commands that it samples or that a user gives.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import INSTRUMENTS, Params
from ballbot_rs.control.reference import RATE, Reference
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.control.setpoints import PARTS, Setpoint
from ballbot_rs.envs._batch_env import new_batch, option_names
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of, geometry_of
from ballbot_rs.viewer.session.drivers import (
    BalancingDriver,
    Driver,
    LawDriver,
    TaskPolicy,
    Torques,
    lead_of,
    make_driver,
)
from ballbot_rs.viewer.session.recording import Commands
from ballbot_rs.viewer.session.robots import Robots
from ballbot_rs.viewer.session.setup import DECIDED

#: Calls a function of a controller, possibly with a time limit.
Call = Callable[[Callable[[], Torques]], Torques]

FloatArray = npt.NDArray[np.float64]

#: Names of the closed curves along which the setpoint moves.
ROUTES: Final = ("circle", "eight")

#: Radius of the circle, m, and half the length of the figure eight, m, which is twice as long as it is wide.
RADIUS: Final = 0.5
HALF_LENGTH: Final = 0.7

#: Largest speed of the setpoint, m/s.
ROUTE_SPEED: Final = 0.3

#: Points of a curve.
ROUTE_SAMPLES: Final = 128

#: Largest coordinate of a setpoint, m.
MAX_SETPOINT = 5.0

#: Geometries of commands that the page gives: by keys, or by a click on the floor.
DRIVEN, CLICKED = "velocity", "point"

#: Slew rates of a driving command, m/s², as of the point of the task path, and rad/s²: keys may be pressed faster than
#: a robot can follow.
ACCELERATION, YAW_ACCELERATION = 0.6, 2.0

#: The term of the samples with the pushes of a task.
TASK_PUSH = "push:task"

#: Largest coordinate of a click, m; the goal is nearer.
MAX_CLICK = 1e3


class Objective(Protocol):
    """Computes the wheel torques of a session's robots by a controller, for the commands of a task or a user."""

    #: Name of the task.
    task: str
    #: Whether a click on the floor is a command.
    takes_clicks: bool
    #: Options of a `Setup`.
    task_options: Mapping[str, Any]

    @property
    def driver(self) -> Driver:
        """The controller on every robot."""

    def torques(self, robots: Robots, call: Call) -> Torques:
        """Wheel torques for the next control step, shape (n, 3), N·m."""

    def reset(self) -> None:
        """All robots restart: manual commands are cleared."""

    def restarted(self, robots: Robots, index: int) -> None:
        """One robot has restarted."""

    def continue_from(self, robots: Robots, before: "Objective") -> None:
        """The robots were replaced, with the new robots at the places of the old."""

    def click(self, robots: Robots, x: float, y: float) -> None:
        """A point of the floor was clicked, m; in a batch it is relative to each robot's start.

        Raises:
            ValueError: a number out of range, or the task does not take a position.
        """

    def shown(self, robots: Robots) -> dict[str, Any]:
        """Its part of a `Frame`."""


@dataclasses.dataclass(frozen=True)
class Route:
    """A curve through a point, m, with a largest speed of the setpoint on it, m/s."""

    name: str
    begin: tuple[float, float]
    speed: float

    def __post_init__(self) -> None:
        if self.name not in ROUTES:
            raise ValueError(f"unknown route '{self.name}': expected one of {', '.join(ROUTES)}")
        if not 0.0 < self.speed <= ROUTE_SPEED:
            raise ValueError(f"speed = {self.speed} is out of range: expected above 0 to {ROUTE_SPEED:g}")

    def at(self, seconds: float) -> FloatArray:
        """The setpoint at a time after the start, m."""
        # The figure eight is fastest at its crossing: √2 times its half length per radian.
        reach = RADIUS if self.name == "circle" else HALF_LENGTH * math.sqrt(2.0)
        return self._point(self.speed * seconds / reach)

    def curve(self) -> FloatArray:
        """Points of the whole curve, m, shape (n, 2)."""
        return np.array([self._point(2.0 * math.pi * i / ROUTE_SAMPLES) for i in range(ROUTE_SAMPLES)])

    def _point(self, phase: float) -> FloatArray:
        if self.name == "circle":
            offset = (RADIUS * math.sin(phase), RADIUS * (1.0 - math.cos(phase)))
        else:
            offset = (HALF_LENGTH * math.sin(phase), 0.5 * HALF_LENGTH * math.sin(2.0 * phase))
        return np.asarray(self.begin) + offset


class Balancing:
    """The objective of the task balance.

    Raises:
        ValueError: a policy that does not fit this robot, or time steps out of range.
    """

    task, takes_clicks = DEFAULT_TASK, True
    task_options: Mapping[str, Any] = {}

    def __init__(self, controller: ResolvedController, params: Params, num_robots: int) -> None:
        self.driver: BalancingDriver = make_driver(controller, params, num_robots)
        self._controller, self._params = controller, params
        self.setpoint = np.zeros(2)
        self._references: list[Reference] = []
        #: The curve along which the setpoint moves, and the time on it so far, s.
        self._route: Route | None = None
        self._route_time = 0.0

    def torques(self, robots: Robots, call: Callable[[Callable[[], Any]], Any]) -> Torques:
        """As `Objective`."""
        driver, states = self.driver, robots.seen
        if self._route is not None:
            self._route_time += driver.control_dt
            self.setpoint = self._route.at(self._route_time)
        if driver.follows_position:
            if not self._references:
                lead = call(lambda: lead_of(self._controller, self._params))
                self._references = [Reference(lead) for _ in states]
                for reference, state in zip(self._references, states, strict=True):
                    reference.start(state.ball_position[:2], state.ball_velocity[:2])
            for reference, state in zip(self._references, states, strict=True):
                reference.advance(self.setpoint, state.ball_position[:2], driver.control_dt)
        targets = [reference.position for reference in self._references] or np.zeros(2)
        inputs: Sequence[Any] = robots.readings if driver.reads_sensors else states
        found: Torques = call(lambda: driver.torques(inputs, targets))
        return found

    def reset(self) -> None:
        """As `Objective`: the setpoint is the origin again."""
        self.driver.reset()
        self._move_to(np.zeros(2))
        self._references = []

    def restarted(self, robots: Robots, index: int) -> None:  # noqa: ARG002
        """As `Objective`; robot 0 takes the setpoint back to the origin."""
        self.driver.reset(index)
        if self._references:
            self._references[index].start((0.0, 0.0), (0.0, 0.0))
        if index == 0:
            self._move_to(np.zeros(2))

    def continue_from(self, robots: Robots, before: Objective) -> None:  # noqa: ARG002
        """As `Objective`."""
        if isinstance(before, Balancing):
            self._move_to(before.setpoint)
            if self.driver.follows_position:
                self._route, self._route_time = before._route, before._route_time

    def click(self, robots: Robots, x: float, y: float) -> None:  # noqa: ARG002
        """As `Objective`: moves the setpoint."""
        goal = np.array([check_bounded(n, v, -MAX_SETPOINT, MAX_SETPOINT) for n, v in (("x", x), ("y", y))])
        self._check_follows()
        self._move_to(goal)

    def follow(self, name: str) -> None:
        """Moves the setpoint along a curve of `ROUTES`, from its present position.

        Raises:
            ValueError: an unknown curve, or a controller that does not follow a position.
        """
        self._check_follows()
        # At this fraction of the target's limits, LQR on `paper` keeps within 2 cm of the curve.
        speed = min(ROUTE_SPEED, 0.35 * RATE * lead_of(self._controller, self._params))
        x, y = self.setpoint.tolist()
        self._route, self._route_time = Route(name, (x, y), speed), 0.0

    def _check_follows(self) -> None:
        if not self.driver.follows_position:
            raise ValueError(f"{self._controller.name} does not follow a setpoint; choose lqr or a policy")

    def _move_to(self, goal: FloatArray) -> None:
        self.setpoint, self._route = goal, None

    def shown(self, robots: Robots) -> dict[str, Any]:  # noqa: ARG002
        """As `Objective`: the setpoint, and the target moving towards it."""
        return {
            "setpoint": self.setpoint if self.driver.follows_position else None,
            "target": self._references[0].position if self._references else None,
            "route": self._route.curve() if self._route is not None else None,
        }


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
        self.task_options: Mapping[str, Any] = {name: value for name, value in given.items() if name not in DECIDED}
        on_ground = {**self.task_options, "robot": params, "terrain": options.get("terrain")}
        made = new_batch(1, task=task, num_threads=1, options=on_ground).options
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
        for index, (now, current) in enumerate(zip(robots.commands, commands, strict=True)):
            # Giving the same command again would restart its error metrics.
            if not np.array_equal(now, current):
                robots[index].set_command(current)
            self._given[index] = current

    def shown(self, robots: Robots) -> dict[str, Any]:
        """As `Objective`: the task's commands."""
        points = np.array([parts["position"] for parts in robots.setpoints])
        begins = np.array([robot.begin for robot in robots])
        pushes = np.array([robot.draws.get(TASK_PUSH, np.full(3, np.nan)) for robot in robots])
        by_hand = self._hand is not None
        commands = Commands(self.task, robots.commands, begins, points, pushes, robots[0].metrics, by_hand)
        return {"commands": commands}


def objective_of(
    controller: ResolvedController, params: Params, num_robots: int, task: str, options: Mapping[str, Any]
) -> Objective:
    """The objective of a task.

    Raises:
        ValueError: a controller that does not fit the robot or the task.
    """
    if task == DEFAULT_TASK:
        for name in (*INSTRUMENTS, "rows"):
            if controller.env_options.get(name) is not None:
                raise ValueError(f"{controller.name} was trained with {name}, which the page does not have for {task}")
        return Balancing(controller, params, num_robots)
    return Commanding(controller, params, num_robots, task, options)
