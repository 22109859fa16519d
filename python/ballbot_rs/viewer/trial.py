"""Trials of a policy on a robot that it was not trained on."""

import math
from collections.abc import Mapping
from typing import Any

from ballbot_rs._core import Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.registration import DEFAULT_TASK, geometry_of
from ballbot_rs.viewer.objective import Objective
from ballbot_rs.viewer.robots import Robots
from ballbot_rs.viewer.setup import Setup

#: Length of a trial, s, and its initial tilts, rad: the page's initial tilt, and perpendicular to it.
SECONDS = 3.0
TILTS = ((math.radians(3.0), 0.0), (0.0, math.radians(3.0)))

#: Options of a task that pushes robots: any robot may fall after a push.
WITHOUT_PUSHES: Mapping[str, Any] = {"push": (0.0, 0.0)}


def check_balances(controller: ResolvedController, objective: Objective, setup: Setup) -> None:
    """Rejects a policy on a robot on which it falls, unless it was trained on that robot.

    Args:
        controller: the policy; a law is not tried.
        objective: the policy's objective on one robot, not used otherwise.
        setup: the robot; it is tried without events and changes, on the model `contact`.

    Raises:
        ValueError: it falls.
    """
    if controller.policy is None or trained_on(controller.env_options) == setup.nominal:
        return
    driver = objective.driver
    tried = Setup(
        setup.name,
        setup.nominal,
        "contact",
        setup.sim_dt,
        setup.max_torque,
        substeps=1 if setup.task == DEFAULT_TASK else setup.substeps,
        task=setup.task,
        task_options={**setup.task_options, **(WITHOUT_PUSHES if geometry_of(setup.task) == "impulse" else {})},
        terrain=setup.terrain,
    )
    for tilt in TILTS:
        robots = Robots(tried, 1)
        robots.reset(tilt)
        objective.reset()
        for step in range(round(SECONDS / driver.control_dt)):
            torques = objective.torques(robots, lambda function: function())
            robots.step(torques, round(driver.control_dt / driver.sim_dt))
            if robots.fallen[0]:
                raise ValueError(
                    f"{controller.name} was trained on another robot and does not balance {setup.name}: in a trial it "
                    f"fell after {(step + 1) * driver.control_dt:.1f} s; choose another controller or robot"
                )


def trained_on(env_options: Mapping[str, Any]) -> Params | None:
    """The robot of the environment that a policy was trained in; None if its file no longer exists."""
    params = env_options.get("params")
    try:
        return new_batch(1, num_threads=1, options={} if params is None else {"params": params}).params(0)
    except OSError:
        return None
