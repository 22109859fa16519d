"""`ballbot compare`: controllers beside each other in scenarios."""

import argparse
import json
from pathlib import Path
from typing import Any

from ballbot_rs import __version__
from ballbot_rs._core import MODELS, ROBOTS, Params
from ballbot_rs.cli import scenario
from ballbot_rs.cli.numbers import MAX_SEED
from ballbot_rs.cli.progress import bar
from ballbot_rs.scenarios.matrix import text
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load, select


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("compare", help="compare controllers in scenarios: tilts, pushes, motions, errors")
    command.add_argument(
        "scenario", nargs="*", metavar="SCENARIO", help="S13-6s, or S13 for all of them (default: all)"
    )
    scenario.add_controller(command, several=True)
    command.add_argument("--file", type=Path, metavar="FILE.toml", help="scenarios of your own")
    command.add_argument("--robot", metavar="NAME|FILE.toml", help=f"{', '.join(ROBOTS)}, or a file (default paper)")
    command.add_argument(
        "--param", action="append", default=[], metavar="NAME=VALUE", help="a parameter of the robot; repeat for more"
    )
    command.add_argument("--model", default="contact", help=f"{', '.join(MODELS)} (default contact)")
    scenario.add_seed(command, "seed of everything random (default 0)", 0, MAX_SEED)
    command.add_argument("--list", action="store_true", help="list the scenarios, and run none")
    scenario.add_verbosity(command, "one row for each controller and scenario")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    chosen = select(arguments.scenario, load(arguments.file))
    if arguments.list:
        width = max(len(one.id) for one in chosen)
        for one in chosen:
            print(f"{one.id.ljust(width)}  {one.title}")
        return
    robot = scenario.params_of(scenario.robot_option(arguments.robot)) if arguments.robot else Params.paper()
    robot = scenario.changed_robot(robot, arguments.param)
    with bar("comparing", arguments.quiet or arguments.json) as progress:
        outcomes = run_scenarios(
            arguments.controller or ["lqr"],
            chosen,
            robot=robot,
            model=arguments.model,
            seed=arguments.seed,
            progress=progress,
        )
    if arguments.json:
        rows = [outcome.row() for outcome in outcomes]
        print(
            json.dumps({"seed": arguments.seed, "ballbot_rs": __version__, "results": rows}, indent=2, allow_nan=False)
        )
    else:
        print(text(outcomes))
