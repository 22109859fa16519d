"""`ballbot replay`: a log compared with a simulation under the same torques: residuals, a figure, a video, the page."""

import argparse
import json
import math
from pathlib import Path
from typing import Any, Final

from ballbot_rs._extras import require
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import logs, page, settings
from ballbot_rs.cli.options.numbers import seconds
from ballbot_rs.cli.options.robots import own_motors, robot_option
from ballbot_rs.cli.progress import bar
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.replay import replay
from ballbot_rs.media.video import check_suffix

#: Options of an environment that a replay has.
_OPTIONS: Final = ("robot", "actuators")
#: Files of the figure.
_SUFFIXES: Final = (".svg", ".pdf", ".png")


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("replay log.csv --robot found.toml", "measured next to simulated, replay.svg"),
    ("replay log.csv --set robot.body_mass=2.5 --video replay.mp4 --begin 2s", "what another mass would explain"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "replay", help="compare a log of a robot with a simulation under the same torques", examples=EXAMPLES
    )
    logs.add_log(command, "", "motors: ")
    settings.add_to(
        command,
        "a parameter of the robot or its motors, as robot.body_mass=2.5, actuators.delay=0.01",
        settings.of_robots,
    )
    logs.add_simulation(command)
    command.add_argument(
        "--begin",
        type=seconds(-math.inf, math.inf),
        metavar="S",
        help="start of the span in figure and video (default: of the log)",
    )
    command.add_argument("--seconds", type=seconds(above=True), default=4.0, help="duration of the span (default 4)")
    shared.add_output(command, "FILE.svg|.pdf|.png", "the figure (default replay.svg)")
    command.add_argument(
        "--video", type=Path, metavar="FILE.mp4|FILE.webp", help="also a video of the span, measured next to simulated"
    )
    command.add_argument("--page", action="store_true", help="also show the log in the browser, over the simulation")
    page.add_to(command)
    shared.add_verbosity(command, "the residuals")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    out = arguments.output or Path("replay.svg")
    if out.suffix not in _SUFFIXES:
        raise ValueError(f"{out}: the name of a figure must end in {', '.join(_SUFFIXES)}")
    if arguments.video is not None:
        check_suffix(arguments.video)
    with require("a figure", "plot"):
        from ballbot_rs.media.figures.replay import draw
        from ballbot_rs.media.figures.style import save
    given = {
        "robot": robot_option(arguments.robot),
        "actuators": own_motors(arguments.robot, arguments.actuators),
    }
    options = settings.apply(settings.assignments(arguments.set), given, {})
    if other := [name for name in options if name not in _OPTIONS]:
        raise ValueError(f"{settings.FLAG} {other[0]}: a replay has {', '.join(f'{name}.NAME' for name in _OPTIONS)}")
    log = SensorLog.read(arguments.log, arguments.columns)
    begin = float(log.time[0]) if arguments.begin is None else arguments.begin
    if not log.time[0] - arguments.seconds < begin <= log.time[-1]:
        raise ValueError(
            f"--begin {begin:g} is outside the log, which has {log.time[-1] - log.time[0]:.2f} s, from "
            f"{log.time[0]:.2f} to {log.time[-1]:.2f} s"
        )
    with bar("replaying", arguments.quiet or arguments.json) as progress:
        found = replay(
            log,
            settings.one_robot(options["robot"]),
            actuators=options["actuators"],
            **logs.simulation(arguments),
            progress=progress,
        )
    save(draw(found, arguments.begin, arguments.seconds), out)
    if arguments.video is not None:
        with bar(f"rendering {arguments.video.name}", arguments.quiet or arguments.json) as progress:
            found.record(arguments.video, arguments.begin, arguments.seconds, progress=progress)
    written = [str(one) for one in (out, arguments.video) if one is not None]
    if arguments.json:
        video = None if arguments.video is None else str(arguments.video)
        print(json.dumps({**found.to_dict(), "file": str(out), "video": video}, indent=2))
    else:
        if log.report is not None:
            print("\n".join(log.report.lines()) + "\n")
        print("\n".join([found.table(), *(f"wrote {one}" for one in written)]))
    if arguments.page:
        with require("the page", "view"):
            from ballbot_rs.viewer.session.logged import session_of
            from ballbot_rs.viewer.view import View
        page.serve(View(session_of(found, Path(arguments.robot).stem), arguments.port), arguments)
