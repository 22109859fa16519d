"""A session from a controller and options of an environment, for the command line and scripts."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from ballbot_rs._core import Params
from ballbot_rs._keywords import check_keywords
from ballbot_rs.control.resolve import ResolvedController, common_options, common_task
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.session.setup import DECIDED


def open_session(
    controller: ResolvedController,
    given: Mapping[str, Any],
    robot_of: Callable[[Any], tuple[str, Params | None]],
    *,
    task: str | None,
    num_robots: int,
    seed: int,
) -> Session:
    """A session of robots under a controller.

    Args:
        controller: of all robots.
        given: options of the environment; they override the options that a policy was trained with.
        robot_of: the robot's name from the option `robot`, and its parameters unless it is a preset.
        task: its name; None is a policy's task, else balance.
        num_robots: number of robots.
        seed: of the samples.

    Raises:
        ValueError: the option `history`, or as `Session`.
        TypeError: the task has no such option.
    """
    if "history" in given:
        raise ValueError(
            "history cannot be set here (--set history=...): the page's policies observe with the history of their "
            "training"
        )
    options = common_options([controller], given)
    robot, params = robot_of(options.get("robot", "paper"))
    # Keep the robot of the policy's training: a session can try the policy on any other robot.
    trained = {name: value for name, value in controller.env_options.items() if name == "robot"}
    kept = {name: value for name, value in options.items() if name != "robot"}
    controller = dataclasses.replace(controller, env_options={**kept, **trained})
    return Session(
        options.get("model", "contact"),
        robot,
        controller,
        num_robots,
        params,
        options.get("actuators"),
        options.get("events"),
        seed,
        options.get("sensors"),
        options.get("observation", "ground_truth"),
        task=task,
        task_options=_of_task(given, common_task([controller], task)),
    )


def _of_task(given: Mapping[str, Any], task: str) -> dict[str, Any]:
    """The options that do not concern the robot, for controllers that the page selects later."""
    check_keywords(f"the environment of {task}", given, option_names(task))
    return {name: value for name, value in given.items() if name == "terrain" or name not in DECIDED}
