"""`ballbot simulate`: one robot under one controller, as a table, a log or a replay."""

import argparse
import json
import re
from pathlib import Path
from typing import Any, Final

from ballbot_rs.analysis.exports import FORMATS, format_of
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import scenario, settings
from ballbot_rs.cli.options.numbers import MAX_SEED, meters
from ballbot_rs.control.resolve import TRAINED

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("simulate --controller lqi --seconds 10 -o run.csv", "a motion as a table"),
    ("simulate --controller lqr --tilt 5deg,0 --push 0.3,0,0 --push-at 500ms -o push.npz", "from a tilt, with a push"),
    ("simulate path --controller lqr --seconds 10 -o run.html", "a replay in 3D for any browser"),
    (
        "simulate --controller lqr --reference position=[0.5,0] --robot kugle --json",
        "a step of the setpoint, with its metrics",
    ),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "simulate", help="simulate a robot and write its motion as a table, a log or a replay", examples=EXAMPLES
    )
    shared.add_task_or_policy(command)
    shared.add_controller(command)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    shared.add_urdf(command)
    shared.add_seed(command, "seed of the events and sensors (default 0)", 0, MAX_SEED)
    names = f"FILE{'|'.join(FORMATS)}"
    shared.add_output(
        command, names, "the motion: columns of docs/simulate.md, or a replay in 3D (default CONTROLLER.csv)"
    )
    scenario.add_to(command, duration=5.0)
    command.add_argument(
        "--position", type=meters(), nargs=2, metavar=("X", "Y"), help="initial position of the ball, m (default 0 0)"
    )
    command.add_argument(
        "--reference",
        action="append",
        default=[],
        metavar="PART=VALUE",
        help="a constant part of the setpoint in SI units and rad, as position=[0.5,0] or yaw=1; repeat for more "
        "(default: the task's)",
    )
    command.add_argument("--json", action="store_true", help="print the file and the metrics of the motion as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    chosen, (controller,) = scenario.on_one_robot(arguments)
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(controller.name).stem)
    out = arguments.output or Path(f"{name}.csv")
    # Before the simulation.
    format_of(out)
    done = simulate(
        controller,
        reference=settings.assignments(arguments.reference, "--reference") or None,
        pushes=chosen.pushes,
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
