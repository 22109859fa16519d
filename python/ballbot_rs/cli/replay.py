"""`ballbot replay`: a log compared with a simulation under the same torques, as a table of residuals and a figure."""

import argparse
import json
from pathlib import Path
from typing import Any, Final

from ballbot_rs._core import load_actuators
from ballbot_rs._extras import require
from ballbot_rs.cli import arguments as shared
from ballbot_rs.cli import log_arguments, settings
from ballbot_rs.cli.numbers import MAX_SECONDS, real
from ballbot_rs.cli.progress import bar
from ballbot_rs.identification.log import SensorLog
from ballbot_rs.identification.replay import replay

#: Options of an environment that a replay has.
_OPTIONS: Final = ("params", "actuators")
#: Files of the figure.
_SUFFIXES: Final = (".svg", ".pdf", ".png")


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("replay", help="compare a log of a robot with a simulation under the same torques")
    log_arguments.add_log(command, "", "motors: ")
    settings.add_to(command, "a parameter of the robot or its motors, as params.body_mass=2.5, actuators.delay=0.01")
    log_arguments.add_simulation(command)
    command.add_argument("--begin", type=real(), metavar="S", help="of the span in the figure (default: of the log)")
    command.add_argument(
        "--seconds", type=real(0.0, MAX_SECONDS, above=True), default=4.0, help="duration of the span (default 4)"
    )
    shared.add_output(command, "FILE.svg|.pdf|.png", "the figure (default replay.svg)")
    shared.add_verbosity(command, "the residuals")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    out = arguments.output or Path("replay.svg")
    if out.suffix not in _SUFFIXES:
        raise ValueError(f"{out}: the name of a figure ends in {', '.join(_SUFFIXES)}")
    with require("a figure", "plot"):
        from ballbot_rs.media.figures.replay import draw
        from ballbot_rs.media.figures.style import save
    given = {
        "params": shared.robot_option(arguments.robot),
        "actuators": None if arguments.actuators is None else load_actuators(arguments.actuators),
    }
    options = settings.apply(settings.assignments(arguments.set), given, {})
    if other := [name for name in options if name not in _OPTIONS]:
        raise ValueError(f"{settings.FLAG} {other[0]}: a replay has {', '.join(f'{name}.NAME' for name in _OPTIONS)}")
    log = SensorLog.read(arguments.log, arguments.columns)
    with bar("replaying", arguments.quiet or arguments.json) as progress:
        found = replay(
            log,
            settings.params_of(options["params"]),
            actuators=options["actuators"],
            model=arguments.model,
            sim_dt=arguments.sim_dt,
            window=arguments.window,
            imu_position=arguments.imu_position,
            num_threads=arguments.threads,
            progress=progress,
        )
    save(draw(found, arguments.begin, arguments.seconds), out)
    if arguments.json:
        print(json.dumps({**found.to_dict(), "file": str(out)}, indent=2))
        return
    if log.report is not None:
        print("\n".join(log.report.lines()) + "\n")
    print(f"{found.table()}\nwrote {out}")
