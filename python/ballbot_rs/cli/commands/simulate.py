"""`ballbot simulate`: one robot under one controller, as a table or a log."""

import argparse
import json
import re
from pathlib import Path
from typing import Any

from ballbot_rs.analysis.exports import FORMATS, format_of
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import settings
from ballbot_rs.cli.options.numbers import MAX_SEED, real
from ballbot_rs.control.resolve import TRAINED


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("simulate", help="simulate a robot and write its motion as a table or a log")
    shared.add_task_or_policy(command)
    shared.add_controller(command)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    shared.add_urdf(command)
    shared.add_seed(command, "seed of the events and sensors (default 0)", 0, MAX_SEED)
    names = "|".join(f"FILE{suffix}" for suffix in FORMATS)
    shared.add_output(command, names, "the motion, its columns in docs/simulate.md (default CONTROLLER.csv)")
    shared.add_scenario(command, seconds=5.0)
    command.add_argument(
        "--position", type=real(), nargs=2, metavar=("X", "Y"), help="initial position of the ball, m (default 0 0)"
    )
    command.add_argument(
        "--reference",
        action="append",
        default=[],
        metavar="PART=VALUE",
        help="a constant part of the setpoint, as position=[0.5,0] or yaw=1; repeat for more (default: the task's)",
    )
    command.add_argument("--json", action="store_true", help="print the file and the metrics of the motion as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    chosen, (controller,) = shared.on_one_robot(arguments)
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(controller.name).stem)
    out = arguments.output or Path(f"{name}.csv")
    # Before the simulation.
    format_of(out)
    done = simulate(
        controller,
        reference=settings.assignments(arguments.reference, "--reference") or None,
        pushes=() if chosen.push is None else chosen.push,
        seconds=chosen.seconds,
        position=arguments.position,
        tilt=chosen.tilt,
        yaw=chosen.yaw,
        task=chosen.task,
        seed=chosen.seed,
        **chosen.env_options,
    )
    done.write(out)
    if arguments.json:
        report = {
            "file": str(out),
            "controller": done.controller,
            "model": done.model,
            "rows": len(done.times),
            "seconds": float(done.times[-1]),
            "fell_at": done.fell_at,
            "metrics": vars(done.metrics()),
        }
        print(json.dumps(report, indent=2))
        return
    print(str(done).strip("<>"))
    print(f"wrote {out}")
