"""`ballbot compare`: controllers side by side in scenarios."""

import argparse
import json
import textwrap
from pathlib import Path
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._core import MODELS, ROBOTS
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import controller_options, settings, sweeps
from ballbot_rs.cli.options.numbers import MAX_SEED
from ballbot_rs.cli.options.robots import robot_option
from ballbot_rs.cli.progress import bar
from ballbot_rs.scenarios.matrix import WIDTH, text
from ballbot_rs.scenarios.metrics import METRICS
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load, select

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("compare S13 S3-at-once --controller lqr --controller mpc", "circles and a push"),
    ("compare --list", "the scenarios"),
    ("compare S8 --controller lqi --controller-option integral=0.2 --json", "a controller with another weight"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "compare", help="compare controllers in scenarios: tilts, pushes, motions, errors", examples=EXAMPLES
    )
    command.add_argument(
        "scenario", nargs="*", metavar="SCENARIO", help="S13-6s, or S13 for all of them (default: all)"
    )
    shared.add_controller(command, several=True)
    command.add_argument("--file", type=Path, metavar="FILE.toml", help="custom scenarios")
    command.add_argument(
        "--robot",
        metavar="NAME|FILE.toml",
        help=f"{', '.join(ROBOTS)}, or a file (default paper)",
    )
    for name in ("actuators", "sensors", "events"):
        command.add_argument(f"--{name}", metavar="NAME|FILE.toml", help=f"{name} in place of the scenarios' own")
    settings.add_to(command, "a parameter of the robot, as robot.body_mass=2.5", settings.of_robots)
    command.add_argument("--model", default="contact", help=f"{', '.join(MODELS)} (default contact)")
    shared.add_seed(command, "seed of everything random (default 0)", 0, MAX_SEED)
    command.add_argument("--list", action="store_true", help="list the scenarios, and run none")
    sweeps.add_to(command, "body_mass, robot, model, actuators.delay or a scenario number such as push", "score")
    shared.add_verbosity(command, "one row for each controller and scenario")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    chosen = select(arguments.scenario, load(arguments.file))
    if arguments.list:
        width = max(len(one.id) for one in chosen)
        for one in chosen:
            indent = " " * (width + 2)
            print(textwrap.fill(f"{one.id.ljust(width)}  {one.title}", WIDTH, subsequent_indent=indent))
        return
    sweep: Any = sweeps.read(arguments, ("score", "success_rate", *METRICS))
    names = arguments.controller or ["lqr"]
    options = controller_options.of(names, arguments.controller_option)
    robot = settings.robot_of(arguments, robot_option(arguments.robot or "paper"))
    with bar("comparing", arguments.quiet or arguments.json) as progress:
        outcomes: Any = run_scenarios(
            [options.get(name, name) for name in names],
            chosen,
            robot=robot,
            model=arguments.model,
            actuators=arguments.actuators,
            sensors=arguments.sensors,
            events=arguments.events,
            seed=arguments.seed,
            sweep=sweep,
            checkpoint=arguments.checkpoint,
            progress=progress,
        )
    if sweep is not None:
        sweeps.write(outcomes, arguments)
        return
    if arguments.json:
        rows = [outcome.row() for outcome in outcomes]
        print(
            json.dumps({"seed": arguments.seed, "ballbot_rs": __version__, "results": rows}, indent=2, allow_nan=False)
        )
    else:
        print(text(outcomes))
