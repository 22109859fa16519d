"""`ballbot identify`: fit parameters of a robot to a log, and write the robot as a TOML file."""

import argparse
import json
from typing import Any, Final

from ballbot_rs import _files
from ballbot_rs._core import ACTUATORS, MODELS, ROBOTS, load_actuators
from ballbot_rs.cli import arguments as shared
from ballbot_rs.cli import settings
from ballbot_rs.cli.numbers import real, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.identification.fit import FIELDS, identify
from ballbot_rs.identification.log import SensorLog
from ballbot_rs.identification.windows import WINDOW_LIMITS

#: Models that a fit can use.
_MODELS: Final = tuple(name for name in MODELS if name != "planar")


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("identify", help="fit parameters of a robot to a log of torques and sensors")
    shared.add_log(command)
    command.add_argument(
        "--robot",
        default="paper",
        metavar="NAME|FILE.toml",
        help=f"to start from: {', '.join(ROBOTS)}, or a file (default paper)",
    )
    command.add_argument(
        "--actuators",
        metavar="NAME|FILE",
        help=f"motors to start from: {', '.join(ACTUATORS)}, or a file (default ideal)",
    )
    command.add_argument(
        "--fields",
        default=",".join(FIELDS),
        metavar="NAME,NAME",
        help=f"what to fit (default {','.join(FIELDS)})",
    )
    command.add_argument("--model", default="contact", help=f"{', '.join(_MODELS)} (default contact)")
    command.add_argument(
        "--sim-dt", type=real(0.0, 0.05, above=True), default=0.002, help="time step of the model, s (default 0.002)"
    )
    command.add_argument(
        "--window",
        type=real(*WINDOW_LIMITS),
        default=0.5,
        help="length of the spans that are simulated, s (default 0.5)",
    )
    command.add_argument(
        "--imu-position",
        type=real(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        default=(0.0, 0.0, 0.0),
        help="of the accelerometer in the body frame, m (default 0 0 0)",
    )
    command.add_argument("--threads", type=whole(1, 256), help="threads of the simulations (default: all cores)")
    shared.add_output(command, "FILE.toml", "the robot, for --robot and --actuators (default: none is written)")
    shared.add_verbosity(command, "the result")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    out = arguments.output
    if out is not None and out.suffix != ".toml":
        raise ValueError(f"{out}: the name of a robot's file ends in .toml")
    params = settings.params_of(shared.robot_option(arguments.robot))
    log = SensorLog.read(arguments.log, arguments.columns)
    actuators = None if arguments.actuators is None else load_actuators(arguments.actuators)
    with bar("identifying", arguments.quiet or arguments.json) as progress:
        found = identify(
            log,
            params,
            tuple(name.strip() for name in arguments.fields.split(",")),
            actuators=actuators,
            model=arguments.model,
            sim_dt=arguments.sim_dt,
            window=arguments.window,
            imu_position=arguments.imu_position,
            num_threads=arguments.threads,
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
