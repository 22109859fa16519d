"""`ballbot evaluate`: compare controllers and policies on the same starts."""

import argparse
import json
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._text_table import print_table
from ballbot_rs.analysis.episodes import MAX_EPISODES, compare
from ballbot_rs.analysis.result import Result
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import sweeps
from ballbot_rs.cli.options.numbers import MAX_SEED, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import TRAINED, common_options, common_task
from ballbot_rs.engines.engine_batch import ENGINES
from ballbot_rs.envs.registration import description_of, env_id_of

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("evaluate --controller lqr --controller pid --episodes 20", "two controllers from the same starts"),
    (
        "evaluate assets/policies/path.onnx --controller lqr --engine mujoco",
        "a policy and a controller, the robot in MuJoCo",
    ),
    (
        "evaluate --controller-option position=0.02 --robot kugle --actuators kugle --episodes 20",
        "a stiffer LQR on another robot with its motors",
    ),
    (
        "evaluate --controller lqr --controller lqi --sweep actuators.delay=0,0.02 -o delay.svg",
        "a study as a figure",
    ),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("evaluate", help="evaluate controllers and policies", examples=EXAMPLES)
    shared.add_task_or_policy(command)
    shared.add_controller(command, several=True)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    command.add_argument(
        "--engine", choices=ENGINES, help="another engine in place of a model, with ideal motors (default: none)"
    )
    shared.add_seed(command, "seed of the first start (default 1000)", 1000, MAX_SEED)
    command.add_argument(
        "--episodes", type=whole(1, MAX_EPISODES), default=100, help="number of episodes (default 100)"
    )
    sweeps.add_to(command, "any option of --set, body_mass, robot, or events.body_mass", "survival_rate")
    shared.add_verbosity(command, "the results")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    arguments.controller = arguments.controller or ["lqr"]
    controllers, options = shared.controllers(arguments), shared.env_options(arguments)
    task = common_task(controllers, arguments.task)
    metrics = [metric["name"] for metric in description_of(task)["metrics"]]
    sweep: Any = sweeps.read(arguments, (*Result.__dataclass_fields__, *metrics))
    with bar("evaluating", arguments.quiet or arguments.json) as progress:
        results: Any = compare(
            controllers,
            task=task,
            episodes=arguments.episodes,
            seed=arguments.seed,
            engine=arguments.engine,
            sweep=sweep,
            checkpoint=arguments.checkpoint,
            progress=progress,
            **options,
        )
    if sweep is not None:
        sweeps.write(results, arguments)
        return
    if arguments.json:
        report = {
            "env_id": env_id_of(task),
            "seed": arguments.seed,
            "ballbot_rs": __version__,
            "results": [vars(result) for result in results],
        }
        print(json.dumps(report, indent=2))
    else:
        shown = common_options(controllers, options)
        # The name of a set of events is clearer than a list of them.
        if isinstance(options.get("events"), str) and options["events"] != TRAINED:
            shown["events"] = options["events"]
        print_table(results, task, shown)
