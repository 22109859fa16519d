"""Options of the command line that say what happens to one robot, the same for every command that shows one."""

import argparse
import dataclasses
from typing import Any

from ballbot_rs.analysis.trajectory import Push, Trajectory, run
from ballbot_rs.control.resolve import Controller
from ballbot_rs.envs.registration import TASKS


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A start, a push and a duration."""

    seconds: float
    tilt: tuple[float, float]
    yaw: float
    push: Push | None
    env_options: dict[str, Any]

    def of(self, controller: str | Controller) -> Trajectory:
        """What a controller makes of it."""
        return run(
            controller,
            seconds=self.seconds,
            tilt=self.tilt,
            yaw=self.yaw,
            push=self.push,
            env_options=self.env_options,
        )


def add_task(command: Any) -> None:
    """Adds the optional task."""
    command.add_argument("task", nargs="?", default="balance", choices=sorted(TASKS), help="the task (default balance)")


def add_to(command: Any, seconds: float) -> None:
    """Adds the options to a command."""
    group = command.add_argument_group("what happens (SI units and radians)")
    group.add_argument("--model", help="rigid, contact, spatial or planar (default: the policy's own, else rigid)")
    group.add_argument("--robot", help="a preset, for example kugle (default: the policy's own, else paper)")
    group.add_argument("--seconds", type=float, default=seconds, help=f"simulated time (default {seconds:g})")
    group.add_argument(
        "--tilt", type=float, nargs=2, metavar=("X", "Y"), default=(0.08, 0.05), help="initial tilt (default 0.08 0.05)"
    )
    group.add_argument("--yaw", type=float, default=0.0, help="initial heading (default 0)")
    group.add_argument(
        "--push", type=float, nargs=3, metavar=("X", "Y", "Z"), help="impulse on the body in N·s (default none)"
    )
    group.add_argument("--push-at", type=float, default=1.0, metavar="TIME", help="time of the push (default 1)")


def scenario(arguments: argparse.Namespace) -> Scenario:
    """What the options say."""
    options = {} if arguments.model is None else {"model": arguments.model}
    if arguments.robot is not None:
        options["params"] = arguments.robot
    push = None if arguments.push is None else Push(tuple(arguments.push), arguments.push_at)
    return Scenario(arguments.seconds, tuple(arguments.tilt), arguments.yaw, push, options)
