"""Balancing at a setpoint that a user moves; controllers get a target moving towards it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Params
from ballbot_rs.control.reference import RATE, Reference
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.viewer.bounds import check_bounded
from ballbot_rs.viewer.drivers import BalancingDriver, Torques, lead_of, make_driver
from ballbot_rs.viewer.objective import Objective
from ballbot_rs.viewer.robots import Robots
from ballbot_rs.viewer.route import MAX_SPEED, Route

FloatArray = npt.NDArray[np.float64]

#: Largest coordinate of a setpoint, m.
MAX_SETPOINT = 5.0


class Balancing:
    """The objective of the task balance.

    Raises:
        ValueError: a policy that does not fit this robot, or time steps out of range.
    """

    task, takes_clicks = DEFAULT_TASK, True

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
        found: Torques = call(lambda: driver.torques(states, targets))
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

    def go_on(self, robots: Robots, before: Objective) -> None:  # noqa: ARG002
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
        """Moves the setpoint along a curve of `route.ROUTES`, from its present position.

        Raises:
            ValueError: an unknown curve, or a controller that does not follow a position.
        """
        self._check_follows()
        # At this fraction of the target's limits, LQR on `paper` keeps within 2 cm of the curve.
        speed = min(MAX_SPEED, 0.35 * RATE * lead_of(self._controller, self._params))
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
