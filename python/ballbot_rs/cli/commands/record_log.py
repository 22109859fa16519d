"""`ballbot record-log`: a log of a simulated robot under excitation while it balances, for `ballbot identify`."""

import argparse
import json
from pathlib import Path
from typing import Any, Final

from ballbot_rs._core import ACTUATORS, MODELS, ROBOTS
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import settings
from ballbot_rs.cli.options.numbers import MAX_SEED, real, seconds
from ballbot_rs.cli.options.robots import own_motors, robot_option
from ballbot_rs.cli.progress import bar
from ballbot_rs.identification.excitation import MAX_SECONDS, NOISE, record_log

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("record-log --seconds 20 -o log.csv", "a log of the paper's robot"),
    (
        "record-log --robot kugle --actuators kugle --seconds 2 --pose -o log.npz",
        "with motors, and poses as of motion capture",
    ),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "record-log", help="record a log of a simulated robot, for identify", examples=EXAMPLES
    )
    command.add_argument(
        "--robot",
        default="paper",
        metavar="NAME|FILE.toml",
        help=f"{', '.join(ROBOTS)}, or a file, whose table [actuators] applies, too (default paper)",
    )
    command.add_argument(
        "--actuators",
        metavar="NAME|FILE",
        help=f"motors: {', '.join(ACTUATORS)}, or a file (default: the robot file's own, else ideal)",
    )
    command.add_argument("--model", default="contact", help=f"{', '.join(MODELS)} (default contact)")
    command.add_argument(
        "--seconds", type=seconds(0.0, MAX_SECONDS, above=True), default=20.0, help="duration (default 20)"
    )
    command.add_argument(
        "--excitation", type=real(0.0, 10.0), default=1.0, help="factor of the multisine and the steps (default 1)"
    )
    command.add_argument("--exact", action="store_true", help="sensors without noise")
    command.add_argument("--pose", action="store_true", help="also exact attitude and position, as of motion capture")
    shared.add_seed(command, "of the excitation and the noise (default 0)", 0, MAX_SEED)
    shared.add_output(command, "FILE.csv|FILE.npz", "the log (default log.csv)")
    shared.add_verbosity(command, "the file")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    out = arguments.output or Path("log.csv")
    if out.suffix not in (".csv", ".npz"):
        raise ValueError(f"{out}: the name of a log must end in .csv or .npz")
    with bar("recording", arguments.quiet or arguments.json) as progress:
        log = record_log(
            settings.one_robot(robot_option(arguments.robot)),
            arguments.seconds,
            actuators=own_motors(arguments.robot, arguments.actuators),
            model=arguments.model,
            noise=None if arguments.exact else NOISE,
            excitation=arguments.excitation,
            pose=arguments.pose,
            seed=arguments.seed,
            progress=progress,
        )
    log.write(out)
    rows, seconds = len(log.time), float(log.time[-1])
    if arguments.json:
        print(json.dumps({"log": str(out), "rows": rows, "seconds": seconds}, indent=2))
    else:
        print(f"{rows} rows over {seconds:g} s\nwrote {out}")
