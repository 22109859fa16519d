"""`ballbot identify`: fit parameters of a robot to a log, and write the robot as a TOML file."""

import argparse
import json
from typing import Any, Final

from ballbot_rs import _files
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import logs, settings
from ballbot_rs.cli.options.robots import own_motors, robot_option
from ballbot_rs.cli.progress import bar
from ballbot_rs.identification.fit import FIELDS, identify
from ballbot_rs.identification.logs.log import SensorLog

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("identify log.csv --robot mine.toml -o found.toml", "fit the default parameters"),
    ("identify log.csv --fields body_mass,body_com_height,delay --json", "fit three of them"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "identify", help="fit parameters of a robot to a log of torques and sensors", examples=EXAMPLES
    )
    logs.add_log(command, "to start from: ", "motors to start from: ")
    command.add_argument(
        "--fields",
        default=",".join(FIELDS),
        metavar="NAME,NAME",
        help=f"what to fit (default {','.join(FIELDS)})",
    )
    logs.add_simulation(command)
    shared.add_output(command, "FILE.toml", "the robot, for --robot and --actuators (default: none is written)")
    shared.add_verbosity(command, "the result")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    out = arguments.output
    if out is not None and out.suffix != ".toml":
        raise ValueError(f"{out}: the name of a robot's file ends in .toml")
    params = settings.one_robot(robot_option(arguments.robot))
    log = SensorLog.read(arguments.log, arguments.columns)
    actuators = own_motors(arguments.robot, arguments.actuators)
    with bar("identifying", arguments.quiet or arguments.json) as progress:
        found = identify(
            log,
            params,
            tuple(name.strip() for name in arguments.fields.split(",")),
            actuators=actuators,
            **logs.simulation(arguments),
            progress=progress,
        )
    if out is not None:
        _files.write(out, found.to_toml())
    if arguments.json:
        report = None if log.report is None else log.report.to_dict()
        print(json.dumps({**found.to_dict(), "log": report, "file": None if out is None else str(out)}, indent=2))
        return
    if log.report is not None:
        print("\n".join(log.report.lines()) + "\n")
    print(found.table())
    print(
        f"\n{found.measurements} measurements in {found.windows} windows, condition number "
        f"{found.condition_number:.0f}."
    )
    if out is not None:
        print(f"wrote {out}")
