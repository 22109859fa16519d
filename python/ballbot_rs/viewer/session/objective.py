"""What commands a session's robots: the interface of `balancing`, a setpoint of the user, and `commanding`, a task."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from ballbot_rs.viewer.session.drivers import Driver, Torques
from ballbot_rs.viewer.session.robots import Robots

#: Calls a function of a controller, possibly with a time limit.
Call = Callable[[Callable[[], Torques]], Torques]


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

    @property
    def reach(self) -> str:
        """The limit of clicks, in words."""

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

    def nearest(self, robots: Robots, x: float, y: float) -> tuple[float, float]:
        """The nearest point to (x, y) that `click` allows, m."""

    def shown(self, robots: Robots) -> dict[str, Any]:
        """Its part of a `Frame`."""
