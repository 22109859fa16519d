"""`ballbot view`: the robot in the browser."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ballbot_rs._core import Params
from ballbot_rs._extras import require
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import page, settings
from ballbot_rs.cli.options.numbers import MAX_SEED, seconds, whole
from ballbot_rs.control.resolve import TRAINED
from ballbot_rs.envs.family import are_several, first_of
from ballbot_rs.viewer.session import MAX_ROBOTS, open_session

if TYPE_CHECKING:
    from ballbot_rs.viewer.view import View


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("view --controller lqr", "push the robot in the browser"),
    ("view velocity --controller lqr --robot kugle", "drive it by keys or a gamepad"),
    ("view runs/mine --events mild --batch 16", "16 robots with random masses and friction"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("view", help="show the robot in the browser, push it, plot it", examples=EXAMPLES)
    shared.add_task_or_policy(command)
    shared.add_controller(command)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    shared.add_seed(command, "seed of the events (default 0)", 0, MAX_SEED)
    shared.add_urdf(command)
    command.add_argument(
        "--batch",
        type=whole(1, MAX_ROBOTS),
        default=1,
        metavar="N",
        help=f"robots at once, 1 to {MAX_ROBOTS} (default 1)",
    )
    page.add_to(command)
    command.add_argument("--seconds", type=seconds(0.0, 1e6, above=True), help="stop after this time")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out; ends with the real-time factor."""
    page.serve(_start(arguments), arguments, arguments.seconds)


def _start(arguments: argparse.Namespace) -> "View":
    (controller,) = shared.controllers(arguments)
    given = shared.env_options(arguments)
    session = open_session(
        controller,
        given,
        lambda params: _robot(arguments, params),
        task=arguments.task,
        num_robots=arguments.batch,
        seed=arguments.seed,
    )
    urdfs = {} if arguments.urdf is None else {session.robots.name: tuple(arguments.urdf)}
    with require("the page", "view"):
        from ballbot_rs.viewer.view import View
    try:
        return View(session, arguments.port, urdfs)
    # The mesh readers raise the exceptions of their formats' libraries.
    except Exception as error:
        if arguments.urdf is None or isinstance(error, OSError):
            raise
        raise ValueError(f"{' and '.join(map(str, arguments.urdf))} cannot be shown: {error}") from error


def _robot(arguments: argparse.Namespace, chosen: Any) -> tuple[str, Params | None]:
    """Name of the robot and, unless it is a preset, its parameters."""
    if arguments.urdf is not None:
        return arguments.urdf[0].stem, Params(**chosen)
    if isinstance(chosen, str):
        return chosen, None
    if are_several(chosen):
        return "the first robot", settings.one_robot(first_of(chosen))
    name = "policy" if arguments.robot is None else Path(arguments.robot).stem
    is_changed = any(text.startswith("robot.") for text in arguments.set)
    return (f"{name} with --set" if is_changed else name), Params(**chosen)
