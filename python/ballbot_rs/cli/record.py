"""`ballbot record`: a video of a robot under a controller, and a picture of it."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ballbot_rs.cli import scenario
from ballbot_rs.cli.numbers import MAX_SECONDS, MAX_SEED, real, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import TRAINED
from ballbot_rs.media.video import FRAME_RATES, check_suffix, picture, renderer_for, write_picture, write_video


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("record", help="record a video of a controller or policy")
    scenario.add_task(command)
    scenario.add_controller(command)
    scenario.add_robot(command)
    scenario.add_events(command, TRAINED)
    scenario.add_urdf(command)
    scenario.add_seed(command, "seed of the events (default 0)", 0, MAX_SEED)
    scenario.add_output(command, "FILE.mp4|FILE.webp", "the video, or an animation (default CONTROLLER.mp4)")
    command.add_argument(
        "--still",
        type=real(0.0, MAX_SECONDS),
        nargs="?",
        const=True,
        metavar="TIME",
        help="also a picture, FILE.png: at a time, else at the largest tilt",
    )
    command.add_argument("--no-video", action="store_true", help="the picture alone; needs --still")
    command.add_argument("--forces", action="store_true", help="show the forces at the contacts as arrows")
    command.add_argument(
        "--size",
        type=whole(1, 8192),
        nargs=2,
        metavar=("WIDTH", "HEIGHT"),
        default=(640, 480),
        help="in pixels (default 640 480)",
    )
    command.add_argument("--samples", type=whole(1, 4), default=4, help="color samples a pixel: 1, 2 or 4 (default 4)")
    command.add_argument("--frame-rate", type=real(*FRAME_RATES), default=50.0, help="frames a second (default 50)")
    command.add_argument("--camera", type=real(), nargs=2, metavar=("AZIMUTH", "ELEVATION"), help="direction in rad")
    command.add_argument("--distance", type=real(0.01, 1000.0), help="of the camera, m")
    scenario.add_scenario(command, seconds=5.0)
    scenario.add_verbosity(command, "the files")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    if arguments.no_video and arguments.still is None:
        raise ValueError("--no-video leaves nothing to write: ask for a picture with --still")
    out = arguments.output or Path(f"{Path(arguments.controller).stem}.mp4")
    check_suffix(out)
    camera = {} if arguments.camera is None else dict(zip(("azimuth", "elevation"), arguments.camera, strict=True))
    if arguments.distance is not None:
        camera["distance"] = arguments.distance
    trajectory = scenario.scenario(arguments).of(scenario.controllers(arguments)[0])
    width, height = arguments.size
    renderer = renderer_for(
        trajectory,
        width=width,
        height=height,
        samples=arguments.samples,
        camera=camera or None,
        urdf=arguments.urdf and tuple(arguments.urdf),
    )
    report: dict[str, Any] = {
        "controller": trajectory.controller,
        "model": trajectory.model,
        "seconds": float(trajectory.times[-1]),
        "fell_at": trajectory.fell_at,
        "draws": {term: _last(rows) for term, rows in trajectory.draws.items()},
    }
    if arguments.still is not None:
        time = trajectory.times[trajectory.of_states("tilt").argmax()] if arguments.still is True else arguments.still
        report["still"] = str(out.with_suffix(".png"))
        write_picture(picture(trajectory, renderer, float(time), arguments.forces), out.with_suffix(".png"))
    if not arguments.no_video:
        with bar(f"rendering {out.name}", arguments.quiet or arguments.json) as progress:
            report["frames"] = write_video(
                trajectory,
                out,
                renderer=renderer,
                frame_rate=arguments.frame_rate,
                forces=arguments.forces,
                progress=progress,
            )
        report["video"] = str(out)
    if arguments.json:
        print(json.dumps(report, indent=2))
        return
    seconds = report["seconds"]
    ending = f"upright for {seconds:.2f} s" if trajectory.fell_at is None else f"fell at {trajectory.fell_at:.2f} s"
    print(f"{trajectory.controller} on {trajectory.model}: {ending}")
    for kind in ("video", "still"):
        if kind in report:
            print(f"wrote {report[kind]}")


def _last(rows: npt.NDArray[np.float64]) -> Any:
    """The last row of draws, with null in place of NaN."""
    row = rows[-1].tolist()
    numbers = [None if math.isnan(number) else number for number in (row if isinstance(row, list) else [row])]
    return numbers if isinstance(row, list) else numbers[0]
