"""`ballbot plot`: figures of controllers, policies and training runs."""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ballbot_rs.cli import scenario
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import CONTROLLERS, common_options, find
from ballbot_rs.envs.registration import BALANCE

FIGURES = ("trajectories", "phase_portrait", "recovery_map", "learning_curve")


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("plot", help="draw figures of controllers, policies and training runs")
    command.add_argument(
        "controllers", nargs="+", metavar="RUN_OR_CONTROLLER", help="pid, lqr, zero, a policy file or a training run"
    )
    command.add_argument(
        "--figure", action="append", choices=FIGURES, help="which figure; repeat for several (default all that apply)"
    )
    command.add_argument("--out", type=Path, default=Path("figures"), help="folder (default figures)")
    command.add_argument("--format", choices=("svg", "pdf"), default="svg", help="beside PNG (default svg)")
    scenario.add_to(command, seconds=4.0)
    command.add_argument("--quiet", action="store_true", help="no progress bar")
    command.add_argument("--json", action="store_true", help="print the files as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    try:
        from ballbot_rs.media.figures.style import save
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"figures need {error.name}: install it with `pip install 'ballbot-rs[plot]'`", name=error.name
        ) from error
    runs = [name for name in arguments.controllers if name not in CONTROLLERS and (Path(name) / "run.json").is_file()]
    wanted = arguments.figure or [name for name in FIGURES if name != "learning_curve" or runs]
    if "learning_curve" in wanted and not runs:
        raise ValueError("a learning curve is of training runs, and none is given")
    files = []
    for name, fig in _draw(wanted, arguments, runs):
        for suffix in (arguments.format, "png"):
            path = arguments.out / f"{name}.{suffix}"
            save(fig, path)
            files.append(str(path))
    print(json.dumps({"files": files}, indent=2) if arguments.json else "\n".join(f"wrote {file}" for file in files))


def _draw(wanted: Sequence[str], arguments: argparse.Namespace, runs: Sequence[str]) -> list[tuple[str, Any]]:
    from ballbot_rs.analysis import recovery_map as recovery
    from ballbot_rs.media.figures import learning_curve, phase_portrait, recovery_map, trajectories
    from ballbot_rs.training.curve import read

    quiet = arguments.quiet or arguments.json
    chosen = scenario.scenario(arguments)
    drawn = []
    # All on the same robot: the policies' own, else the default.
    found = [find(name, BALANCE) for name in arguments.controllers]
    chosen = dataclasses.replace(chosen, env_options=common_options(found, chosen.env_options))
    if {"trajectories", "phase_portrait"} & set(wanted):
        moving = [chosen.of(controller) for controller in found]
        if "trajectories" in wanted:
            drawn.append(("trajectories", trajectories.draw(moving)))
        if "phase_portrait" in wanted:
            drawn.append(("phase_portrait", phase_portrait.draw(moving)))
    if "recovery_map" in wanted:
        maps = []
        for controller in found:
            with bar(f"recovery of {controller.name}", quiet) as progress:
                maps.append(recovery.collect(controller, env_options=chosen.env_options, progress=progress))
        drawn.append(("recovery_map", recovery_map.draw(maps)))
    if "learning_curve" in wanted:
        drawn.append(("learning_curve", learning_curve.draw([read(Path(name)) for name in runs])))
    return drawn
