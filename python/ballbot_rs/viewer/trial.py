"""Trials of a policy on a robot that it was not trained on."""

import math
from collections.abc import Mapping
from typing import Any

from ballbot_rs._core import Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.viewer.drivers import make_driver
from ballbot_rs.viewer.robots import Robots
from ballbot_rs.viewer.setup import Setup

#: Length of a trial, s, and the tilts from which it starts, rad: what the page starts with, and across.
SECONDS = 3.0
TILTS = ((math.radians(3.0), 0.0), (0.0, math.radians(3.0)))


def check_balances(controller: ResolvedController, robot: str, params: Params) -> None:
    """Refuses a policy on a robot on which it falls, unless it was trained on that robot.

    Raises:
        ValueError: it falls.
    """
    if controller.policy is None or trained_on(controller.env_options) == params:
        return
    driver = make_driver(controller, params, 1)
    for tilt in TILTS:
        robots = Robots(Setup(robot, params, "contact", driver.sim_dt, driver.max_torque), 1)
        robots.reset(tilt)
        driver.reset()
        for step in range(round(SECONDS / driver.control_dt)):
            robots.step(driver.torques(robots.states, (0.0, 0.0)), round(driver.control_dt / driver.sim_dt))
            if robots.fallen[0]:
                raise ValueError(
                    f"{controller.name} was trained on another robot and does not balance {robot}: in a trial it fell "
                    f"after {(step + 1) * driver.control_dt:.1f} s; choose another controller or robot"
                )


def trained_on(env_options: Mapping[str, Any]) -> Params | None:
    """The robot of the environment that a policy was trained in; None if its file is no longer there."""
    params = env_options.get("params")
    try:
        return new_batch(1, num_threads=1, options={} if params is None else {"params": params}).params(0)
    except OSError:
        return None
