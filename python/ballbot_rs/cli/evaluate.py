"""`ballbot evaluate`: run controllers or policies on the same starts and compare them."""

import argparse
import json
from typing import Any

from ballbot_rs import __version__
from ballbot_rs._text_table import print_table
from ballbot_rs.analysis.episodes import compare
from ballbot_rs.cli.progress import bar
from ballbot_rs.envs.registration import TASKS


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("evaluate", help="evaluate controllers and policies")
    command.add_argument("task", choices=sorted(TASKS), help="the task")
    command.add_argument(
        "--controller",
        action="append",
        required=True,
        metavar="pid|lqr|zero|PATH",
        help="a controller, a policy file or a run; repeat to compare several",
    )
    command.add_argument("--episodes", type=int, default=100, help="how many episodes (default 100)")
    command.add_argument("--model", help="rigid, contact, spatial or planar (default: the policies' own, else rigid)")
    command.add_argument("--seed", type=int, default=1000, help="seed of the first start (default 1000)")
    command.add_argument("--quiet", action="store_true", help="no progress bar")
    command.add_argument("--json", action="store_true", help="print JSON instead of a table")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    options = {} if arguments.model is None else {"model": arguments.model}
    with bar("evaluating", arguments.quiet or arguments.json) as progress:
        results = compare(
            arguments.controller,
            env_id=TASKS[arguments.task],
            episodes=arguments.episodes,
            seed=arguments.seed,
            env_options=options,
            progress=progress,
        )
    if arguments.json:
        report = {
            "env_id": TASKS[arguments.task],
            "seed": arguments.seed,
            "ballbot_rs": __version__,
            "results": [vars(result) for result in results],
        }
        print(json.dumps(report, indent=2))
    else:
        print_table(results)
