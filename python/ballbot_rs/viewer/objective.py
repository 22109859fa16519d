"""What a session has its robots do: the interface of `balancing` and `commanding`."""

from collections.abc import Callable
from typing import Any, Protocol

from ballbot_rs.viewer.drivers import Driver, Torques
from ballbot_rs.viewer.robots import Robots

#: Calls a function of a controller, which may be limited in time.
Call = Callable[[Callable[[], Torques]], Torques]


class Objective(Protocol):
    """Chooses the wheel torques of the robots of a session by a controller, for what a task or a user asks."""

    #: Name of the task.
    task: str
    #: Whether a click on the floor asks for something.
    takes_clicks: bool

    @property
    def driver(self) -> Driver:
        """The controller on every robot."""

    def torques(self, robots: Robots, call: Call) -> Torques:
        """Wheel torques for the next control step, shape (n, 3), N·m."""

    def reset(self) -> None:
        """All robots start anew: what was asked by hand is forgotten."""

    def restarted(self, robots: Robots, index: int) -> None:
        """One robot has started anew."""

    def go_on(self, robots: Robots, before: "Objective") -> None:
        """The robots are others now, where those of the objective before were."""

    def click(self, robots: Robots, x: float, y: float) -> None:
        """A point of the floor was clicked, m; in a batch it is seen from where each robot started.

        Raises:
            ValueError: a number out of range, or no place is asked for.
        """

    def shown(self, robots: Robots) -> dict[str, Any]:
        """What a `Frame` has of it."""
