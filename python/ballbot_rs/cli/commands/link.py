"""`ballbot link`: a simulated robot whose controller is another process or a board; or that controller."""

import argparse
import contextlib
import json
import sys
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _interrupts
from ballbot_rs._core import ACTUATORS, SENSORS
from ballbot_rs._errors import ControllerError, InvalidInputError
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import controller_options, scenario, settings
from ballbot_rs.cli.options.numbers import MAX_SEED, real, seconds, whole
from ballbot_rs.control.laws import Law, reads_sensors
from ballbot_rs.control.resolve import CONTROL_DT, find
from ballbot_rs.link.estimated import EstimatedController
from ballbot_rs.link.faults import MAX_DELAY, LinkFaults
from ballbot_rs.link.link import MAX_COUNT, MAX_SECONDS, ON_TIMEOUT, Link
from ballbot_rs.link.peer import MAX_IDLE, LinkPeer

#: Options of the environment that a controller with its estimator depends on.
#: Largest file of parameters, bytes.
MAX_ROBOT_FILE = 1 << 20

OF_PEERS = ("robot", "sensors", "control_dt")


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("link exec:./board --robot kugle --seconds 5", "a program as the controller"),
    ("link serial:/dev/ttyACM0?baud=921600 --robot mine.toml --real-time", "a board"),
    ("link stdio: --peer lqr --robot kugle", "be the controller"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "link", help="simulate a robot whose controller is another process or a board", examples=EXAMPLES
    )
    command.add_argument(
        "address",
        metavar="ADDRESS",
        help="udp://HOST:PORT, serial:/dev/NAME?baud=RATE, or exec:COMMAND for a child process; with --peer "
        "stdio: for such a child process",
    )
    shared.add_task(command)
    command.add_argument(
        "--peer",
        metavar="NAME|FILE.py:NAME",
        help="act as the controller: a built-in law on the estimator of --robot and --sensors, or your own",
    )
    controller_options.add_to(command, "the controller of --peer")
    command.add_argument(
        "--idle", type=seconds(0.0, MAX_IDLE), default=600.0, help="s without readings until a peer ends (default 600)"
    )
    shared.add_robot(command, otherwise="the robot's own, else")
    shared.add_events(command)
    shared.add_seed(command, "seed of events, sensors and faults (default 0)", 0, MAX_SEED)
    command.add_argument("--real-time", action="store_true", help="run in real time (default: wait for the torques)")
    time = seconds(0.0, MAX_SECONDS)
    command.add_argument("--timeout", type=time, default=0.1, help="time, s, until readings are resent (default 0.1)")
    command.add_argument("--retries", type=whole(0, MAX_COUNT), default=3, help="repetitions in a step (default 3)")
    command.add_argument(
        "--on-timeout", choices=ON_TIMEOUT, default="hold", help="torques in a step that receives none (default hold)"
    )
    command.add_argument("--hold", type=whole(0, MAX_COUNT), default=10, help="maximum hold, steps (default 10)")
    command.add_argument("--give-up", type=time, default=5.0, help="s without torques until the run ends (default 5)")
    command.add_argument("--connect", type=time, default=10.0, help="--give-up at the start, s (default 10)")
    faults = command.add_argument_group("injected faults (probabilities per frame, in each direction)")
    for name in ("drop", "corrupt", "duplicate", "delay"):
        faults.add_argument(f"--{name}", type=real(0.0, 1.0), default=0.0, help="(default 0)")
    faults.add_argument("--delay-time", type=seconds(0.0, MAX_DELAY), default=0.02, help="of --delay, s (default 0.02)")
    command.add_argument("--log", type=Path, metavar="FILE.mcap", help="log of the whole exchange")
    scenario.add_to(command, duration=5.0)
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    _use_own_stages(arguments)
    if arguments.peer is not None:
        LinkPeer(_law(arguments), arguments.address, idle=arguments.idle).serve()
        return
    if arguments.controller_option:
        raise ValueError(f"{controller_options.FLAG} {arguments.controller_option[0]} needs --peer")
    # A signal ends the child process and completes the log.
    with _interrupts.patient(), _link(arguments) as link:
        try:
            trajectory = scenario.scenario_of(arguments).of(link.open())
        except (ControllerError, InvalidInputError, KeyboardInterrupt):
            # A terminal that has hung up takes no output.
            with contextlib.suppress(OSError):
                if link.statistics.steps:
                    print(link.statistics.text(), file=sys.stderr)
            raise
    _print(arguments, link, trajectory)


def _use_own_stages(arguments: argparse.Namespace) -> None:
    """Motors and sensors of a preset are its own, as a board would meet them, unless they are named."""
    robot = arguments.robot
    for stage, known in (("actuators", ACTUATORS), ("sensors", SENSORS)):
        if robot is None or getattr(arguments, stage) is not None:
            continue
        if robot in known:
            setattr(arguments, stage, robot)


def _law(arguments: argparse.Namespace) -> Law:
    options = shared.env_options(arguments)
    if others := sorted(set(options) - {*OF_PEERS, "actuators"}):
        raise ValueError(f"a peer does not depend on {', '.join(others)}, only on {', '.join(OF_PEERS)}")
    given = controller_options.of([arguments.peer], arguments.controller_option)
    found = given.get(arguments.peer) or find(arguments.peer)
    params = settings.one_robot(options.get("robot", "paper"))
    control_dt = options.get("control_dt") or found.control_dt or CONTROL_DT
    if found.make_law is not None and reads_sensors(law := found.law(params, control_dt)):
        return law
    return EstimatedController(found, params, options.get("sensors", "exact"), control_dt)


def _link(arguments: argparse.Namespace) -> Link:
    return Link(
        arguments.address,
        real_time=arguments.real_time,
        timeout=arguments.timeout,
        retries=arguments.retries,
        on_timeout=arguments.on_timeout,
        hold=arguments.hold,
        give_up=arguments.give_up,
        connect=arguments.connect,
        faults=LinkFaults(
            arguments.drop,
            arguments.corrupt,
            arguments.duplicate,
            arguments.delay,
            arguments.delay_time,
            arguments.seed,
        ),
        log=arguments.log,
    )


def _print(arguments: argparse.Namespace, link: Link, trajectory: Trajectory) -> None:
    if arguments.json:
        report = {
            "address": link.address,
            "model": trajectory.model,
            "seconds": float(trajectory.times[-1]),
            "fell_at": trajectory.fell_at,
            "log": None if arguments.log is None else str(arguments.log),
            **link.statistics.report(),
        }
        print(json.dumps(report, indent=2))
        return
    fell_at = trajectory.fell_at
    print(f"upright for {trajectory.times[-1]:.2f} s" if fell_at is None else f"fell at {fell_at:.2f} s")
    print(link.statistics.text())
    if arguments.log is not None:
        print(f"wrote {arguments.log}")
