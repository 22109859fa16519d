"""The commands of a session's robots, and the torques that follow from them.

In the task balance a user moves a setpoint; another task has commands that it samples or that a user gives.
"""

from collections.abc import Mapping
from typing import Any

from ballbot_rs._core import INSTRUMENTS, Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.viewer.session.balancing import Balancing
from ballbot_rs.viewer.session.commanding import Commanding
from ballbot_rs.viewer.session.objective import Objective


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
