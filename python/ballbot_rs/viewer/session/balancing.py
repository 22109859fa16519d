"""The task balance: a user moves the setpoint, by clicks or along a curve."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Params
from ballbot_rs.control.reference import RATE, Reference
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.viewer.session.drivers import BalancingDriver, Torques, lead_of, make_driver
from ballbot_rs.viewer.session.objective import Objective
from ballbot_rs.viewer.session.robots import Robots

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
    reach = f"the limit is {MAX_SETPOINT:g} m along x and y"
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

    def nearest(self, robots: Robots, x: float, y: float) -> tuple[float, float]:  # noqa: ARG002
        """As `Objective`."""
        inside = np.clip((x, y), -MAX_SETPOINT, MAX_SETPOINT)
        return float(inside[0]), float(inside[1])

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
