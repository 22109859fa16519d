"""`ballbot plot`: figures of controllers, policies and training runs."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ballbot_rs._extras import require
from ballbot_rs.cli import scenario
from ballbot_rs.cli.numbers import MAX_SEED
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import NAMES, TRAINED

FIGURES = ("trajectories", "estimates", "phase_portrait", "recovery_map", "learning_curve")


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("plot", help="draw figures of controllers, policies and training runs")
    scenario.add_task(command)
    scenario.add_controller(command, several=True)
    scenario.add_robot(command)
    scenario.add_events(command, TRAINED)
    scenario.add_seed(command, "seed of the events (default 0)", 0, MAX_SEED)
    scenario.add_output(command, "FOLDER", "folder (default figures)")
    command.add_argument(
        "--figure", action="append", choices=FIGURES, help="which figure; repeat for several (default all that apply)"
    )
    command.add_argument("--format", choices=("svg", "pdf"), default="svg", help="beside PNG (default svg)")
    scenario.add_scenario(command, seconds=4.0)
    scenario.add_verbosity(command, "the files")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    with require("a figure", "plot"):
        from ballbot_rs.media.figures.style import save
    arguments.controller = arguments.controller or ["lqr"]
    output = arguments.output or Path("figures")
    runs = [name for name in arguments.controller if name not in NAMES and (Path(name) / "run.json").is_file()]
    options = scenario.env_options(arguments)
    measured = options.get("observation") == "sensors"
    unfit = {"learning_curve": not runs, "recovery_map": bool(options.get("events")), "estimates": not measured}
    wanted = arguments.figure or [name for name in FIGURES if not unfit.get(name)]
    if "learning_curve" in wanted and not runs:
        raise ValueError("a learning curve is of training runs, and none is given")
    if "estimates" in wanted and not measured:
        raise ValueError("estimates are of tasks that observe sensors: add --set observation=sensors")
    files = []
    for name, fig in _draw(wanted, arguments, runs):
        for suffix in (arguments.format, "png"):
            path = output / f"{name}.{suffix}"
            save(fig, path)
            files.append(str(path))
    print(json.dumps({"files": files}, indent=2) if arguments.json else "\n".join(f"wrote {file}" for file in files))


def _draw(wanted: Sequence[str], arguments: argparse.Namespace, runs: Sequence[str]) -> list[tuple[str, Any]]:
    from ballbot_rs.analysis import recovery_map as recovery
    from ballbot_rs.media.figures import estimates, learning_curve, phase_portrait, recovery_map, trajectories
    from ballbot_rs.training.curve import read

    quiet = arguments.quiet or arguments.json
    chosen, found = scenario.on_one_robot(arguments)
    drawn = []
    if {"trajectories", "estimates", "phase_portrait"} & set(wanted):
        moving = [chosen.of(controller) for controller in found]
        if "trajectories" in wanted:
            drawn.append(("trajectories", trajectories.draw(moving)))
        if "estimates" in wanted:
            drawn.append(("estimates", estimates.draw(moving)))
        if "phase_portrait" in wanted:
            drawn.append(("phase_portrait", phase_portrait.draw(moving)))
    if "recovery_map" in wanted:
        maps = []
        for controller in found:
            with bar(f"recovery of {controller.name}", quiet) as progress:
                maps.append(
                    recovery.collect(controller, task=chosen.task, env_options=chosen.env_options, progress=progress)
                )
        drawn.append(("recovery_map", recovery_map.draw(maps)))
    if "learning_curve" in wanted:
        drawn.append(("learning_curve", learning_curve.draw([read(Path(name)) for name in runs])))
    return drawn
