"""Options of a motion: its start, its duration and pushes; and the motion itself."""

import argparse
import dataclasses
import math
from typing import Any, Final

from ballbot_rs._errors import InvalidInputError
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options.numbers import MAX_TURN, angle, real, seconds
from ballbot_rs.control.resolve import ResolvedController, Source, common_options, common_task, options_of

#: Of a robot that lies on its side, rad.
MAX_TILT: Final = math.pi / 2


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A start, pushes and a duration."""

    seconds: float
    tilt: tuple[float, float]
    yaw: float
    pushes: tuple[Push, ...]
    env_options: dict[str, Any]
    task: str | None
    #: Seed of the events.
    seed: int = 0

    def of(self, controller: Source) -> Trajectory:
        """The trajectory under a controller."""
        return simulate(
            controller,
            seconds=self.seconds,
            tilt=self.tilt,
            yaw=self.yaw,
            pushes=self.pushes,
            task=self.task,
            seed=self.seed,
            **self.env_options,
        )

    @property
    def motion(self) -> dict[str, Any]:
        """The fields without the seed, as arguments."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "seed"}


def add_to(command: Any, duration: float) -> None:
    """Adds duration, start and pushes."""
    group = command.add_argument_group("scenario (s, rad and N·s; also 5deg, 200ms)")
    group.add_argument(
        "--seconds",
        type=seconds(above=True),
        default=duration,
        help=f"simulated time (default {duration:g})",
    )
    group.add_argument(
        "--tilt",
        type=angle(MAX_TILT),
        nargs=2,
        metavar=("X", "Y"),
        default=(0.08, 0.05),
        help="initial tilt (default 0.08 0.05)",
    )
    group.add_argument("--yaw", type=angle(MAX_TURN), default=0.0, help="initial heading (default 0)")
    group.add_argument(
        "--push",
        type=real(),
        nargs=3,
        action="append",
        default=[],
        metavar=("X", "Y", "Z"),
        help="impulse on the body (default none); repeat for more",
    )
    group.add_argument(
        "--push-at",
        type=seconds(),
        action="append",
        metavar="TIME",
        help="time of the push (default 1); repeat for each",
    )


def scenario_of(arguments: argparse.Namespace) -> Scenario:
    """The scenario that the command line describes."""
    impulses, given = arguments.push, arguments.push_at or []
    times = given or [1.0]
    # A time without a push is harmless.
    if len(times) != max(len(impulses), 1):
        raise InvalidInputError(f"{len(impulses)} --push and {len(given)} --push-at: name a time for each push")
    return Scenario(
        arguments.seconds,
        tuple(arguments.tilt),
        arguments.yaw,
        tuple(Push(tuple(impulse), time) for impulse, time in zip(impulses, times, strict=False)),
        shared.env_options(arguments),
        arguments.task,
        getattr(arguments, "seed", 0),
    )


def on_one_robot(arguments: argparse.Namespace) -> tuple[Scenario, list[ResolvedController]]:
    """The scenario and its controllers, all on the task and robot of the policies, else on the default."""
    chosen = scenario_of(arguments)
    found = shared.controllers(arguments)
    chosen = dataclasses.replace(chosen, task=common_task(found, chosen.task))
    common = common_options(found, chosen.env_options)
    found = [
        dataclasses.replace(controller, env_options=options_of(controller, common, chosen.env_options))
        for controller in found
    ]
    if "events" in chosen.env_options:
        chosen = dataclasses.replace(chosen, env_options={**chosen.env_options, "events": common["events"]})
    return chosen, found


def trajectories(arguments: argparse.Namespace) -> list[Trajectory]:
    """The trajectories of all controllers of the command line."""
    chosen, found = on_one_robot(arguments)
    return [chosen.of(controller) for controller in found]
