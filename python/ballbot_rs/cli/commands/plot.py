"""`ballbot plot`: figures of controllers, policies and training runs."""

import argparse
import functools
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from ballbot_rs._extras import require
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import scenario
from ballbot_rs.cli.options.numbers import LENGTHS, MAX_SEED, real
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import NAMES, TRAINED

FIGURES = ("trajectories", "estimates", "phase_portrait", "recovery_map", "sensitivity", "learning_curve")

#: Kinds of files with the numbers of a figure.
DATA_FORMATS = ("csv", "npz")
#: mm in an inch, and the narrowest and widest figure, inches.
MM, WIDTHS = 25.4, (2.0, 40.0)


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("plot --controller lqr --controller pid --push 0.4,0,0 -o figures", "figures of a push"),
    (
        "plot --controller lqr --figure trajectories --width 89mm --format pdf --data",
        "for one column of a paper, with the numbers as CSV",
    ),
    ("plot runs/mine --figure learning_curve", "the learning curve of a run"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "plot", help="draw figures of controllers, policies and training runs", examples=EXAMPLES
    )
    shared.add_task_or_policy(command)
    shared.add_controller(command, several=True)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    shared.add_seed(command, "seed of the events (default 0)", 0, MAX_SEED)
    shared.add_output(command, "FOLDER", "folder (default figures)")
    command.add_argument(
        "--figure",
        action="append",
        choices=FIGURES,
        metavar="FIGURE",
        help=f"one of {', '.join(FIGURES)}; repeat for several (default all that apply but sensitivity)",
    )
    command.add_argument("--format", choices=("svg", "pdf"), default="svg", help="in addition to PNG (default svg)")
    command.add_argument(
        "--width",
        type=real(MM * WIDTHS[0], MM * WIDTHS[1], units=LENGTHS, unit="mm"),
        metavar="MM",
        help="width of the figures in mm, for example 89 for one column of a paper (default: to fit panels)",
    )
    command.add_argument(
        "--overlay", action="store_true", help="the trajectories of all controllers in common axes, not side by side"
    )
    command.add_argument(
        "--data",
        nargs="?",
        choices=DATA_FORMATS,
        const="csv",
        help="also the numbers of each figure, one file per controller (default csv)",
    )
    scenario.add_to(command, duration=4.0)
    shared.add_verbosity(command, "the files")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    with require("a figure", "plot"):
        from ballbot_rs.media.figures.data import write as write_table
        from ballbot_rs.media.figures.style import save
    arguments.controller = arguments.controller or ["lqr"]
    output = arguments.output or Path("figures")
    runs = [name for name in arguments.controller if name not in NAMES and (Path(name) / "run.json").is_file()]
    options = shared.env_options(arguments)
    measured = options.get("observation") == "sensors"
    unfit = {"learning_curve": not runs, "recovery_map": bool(options.get("events")), "estimates": not measured}
    # Sensitivities are of motions without a fall: they are drawn only on request.
    selected = arguments.figure or [name for name in FIGURES if name != "sensitivity" and not unfit.get(name)]
    if "learning_curve" in selected and not runs:
        raise ValueError("a learning curve needs training runs, and none is given")
    if "estimates" in selected and not measured:
        raise ValueError("estimates need a task that observes sensors: add --set observation=sensors")
    files = []
    for drawn in _draw(selected, arguments, runs):
        for suffix in (arguments.format, "png"):
            path = output / f"{drawn.name}.{suffix}"
            save(drawn.figure, path)
            files.append(str(path))
        for path, table in _tables(drawn, output, arguments.data) if arguments.data else ():
            if str(path) not in files:
                write_table(table, path)
                files.append(str(path))
    print(json.dumps({"files": files}, indent=2) if arguments.json else "\n".join(f"wrote {file}" for file in files))


class _Drawn(NamedTuple):
    """A figure, the name of its file, and its numbers."""

    name: str
    figure: Any
    #: Prefix of the files of its numbers.
    data_name: str
    #: One per controller or run.
    owners: Sequence[str]
    tables: Sequence[Callable[[], dict[str, Any]]]


def _tables(drawn: _Drawn, output: Path, suffix: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Files and their tables; owners that would share a file are numbered."""
    names = [re.sub(r"[^A-Za-z0-9._-]+", "_", owner) for owner in drawn.owners]
    for i, (name, table) in enumerate(zip(names, drawn.tables, strict=True)):
        again = f"-{names[:i].count(name) + 1}" if name in names[:i] else ""
        yield output / f"{drawn.data_name}-{name}{again}.{suffix}", table()


def _draw(selected: Sequence[str], arguments: argparse.Namespace, runs: Sequence[str]) -> list[_Drawn]:
    from ballbot_rs.analysis import recovery_map as recovery
    from ballbot_rs.analysis import sensitivity as sensitive
    from ballbot_rs.media.figures import (
        estimates,
        learning_curve,
        overlay,
        phase_portrait,
        recovery_map,
        sensitivity,
        trajectories,
    )
    from ballbot_rs.media.figures.data import of_curve, of_recovery, of_sensitivity
    from ballbot_rs.media.figures.labels import short
    from ballbot_rs.training.curve import read

    quiet = arguments.quiet or arguments.json
    chosen, found = scenario.on_one_robot(arguments)
    drawn: list[_Drawn] = []
    inches = None if arguments.width is None else arguments.width / MM
    if {"trajectories", "estimates", "phase_portrait"} & set(selected):
        moving = [chosen.of(controller) for controller in found]
        owners, tables = [short(one.controller) for one in moving], [one.columns for one in moving]
        over_time = overlay if arguments.overlay else trajectories
        drawers = {"trajectories": over_time, "estimates": estimates, "phase_portrait": phase_portrait}
        for name, drawer in drawers.items():
            if name in selected:
                # Their numbers are the same.
                drawn.append(_Drawn(name, drawer.draw(moving, inches), "trajectory", owners, tables))
    if "recovery_map" in selected:
        maps = []
        for controller in found:
            with bar(f"recovery of {controller.name}", quiet) as progress:
                maps.append(
                    recovery.collect(controller, task=chosen.task, env_options=chosen.env_options, progress=progress)
                )
        tables = [functools.partial(of_recovery, one) for one in maps]
        owners = [short(one.controller) for one in maps]
        drawn.append(_Drawn("recovery_map", recovery_map.draw(maps, inches), "recovery_map", owners, tables))
    if "sensitivity" in selected:
        effects = []
        for controller in found:
            with bar(f"sensitivity of {controller.name}", quiet) as progress:
                effects.append(sensitive.collect(controller, **chosen.motion, progress=progress))
        tables = [functools.partial(of_sensitivity, one) for one in effects]
        owners = [short(one.controller) for one in effects]
        drawn.append(_Drawn("sensitivity", sensitivity.draw(effects, inches), "sensitivity", owners, tables))
    if "learning_curve" in selected:
        curves = [read(Path(name)) for name in runs]
        tables = [functools.partial(of_curve, one) for one in curves]
        owners = [one.folder.resolve().name for one in curves]
        drawn.append(_Drawn("learning_curve", learning_curve.draw(curves, inches), "learning_curve", owners, tables))
    return drawn
