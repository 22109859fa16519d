"""`ballbot record`: a video of robots under controllers, and a picture of them."""

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Renderer
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import scenario
from ballbot_rs.cli.options.numbers import MAX_SEED, MAX_TURN, angle, meters, real, seconds, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.control.resolve import TRAINED
from ballbot_rs.media.animation import write_picture
from ballbot_rs.media.video import FRAME_RATES, check_suffix, renderer_for, side_by_side, write_video

#: Color samples per pixel of a picture: a single picture may take time.
STILL_SAMPLES = 4


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("record --controller lqr --push 0.3,0.1,0 --forces -o push.mp4", "a video of a push"),
    ("record goal --controller lqr --controller pid -o goal.gif", "two robots side by side"),
    ("record --controller lqr --tilt 5deg,0 --seconds 1 --no-video --still 0.2 --schematic", "a picture at 0.2 s"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("record", help="record a video of a controller or policy", examples=EXAMPLES)
    shared.add_task_or_policy(command)
    shared.add_controller(command, several=True)
    shared.add_robot(command)
    shared.add_events(command, TRAINED)
    shared.add_urdf(command)
    shared.add_seed(command, "seed of the events (default 0)", 0, MAX_SEED)
    shared.add_output(
        command, "FILE", "a video (.mp4), an animation (.webp, .gif) or frames (F-%%04d.png) (default CONTROLLER.mp4)"
    )
    command.add_argument(
        "--still",
        type=seconds(),
        nargs="?",
        const=True,
        metavar="TIME",
        help="also a picture, FILE.png: at the given time, otherwise at the largest tilt",
    )
    command.add_argument("--no-video", action="store_true", help="only the picture; needs --still")
    command.add_argument("--forces", action="store_true", help="show the forces at the contacts as arrows")
    command.add_argument("--no-caption", action="store_true", help="omit controller, time and tilt from the corner")
    command.add_argument(
        "--schematic", action="store_true", help="plain shapes in place of meshes, which take three times as long"
    )
    command.add_argument(
        "--size",
        type=whole(1, 8192),
        nargs=2,
        metavar=("WIDTH", "HEIGHT"),
        default=(640, 480),
        help="size of the picture of each robot in pixels (default 640 480)",
    )
    command.add_argument(
        "--samples",
        type=whole(1, 4),
        help="color samples per pixel: 1 with blended edges, 2 or 4 (default 1, for a picture 4)",
    )
    command.add_argument("--frame-rate", type=real(*FRAME_RATES), default=50.0, help="frames per second (default 50)")
    command.add_argument(
        "--camera", type=angle(MAX_TURN), nargs=2, metavar=("AZIMUTH", "ELEVATION"), help="direction, rad"
    )
    command.add_argument("--distance", type=meters(0.01, 1000.0), help="distance of the camera, m")
    scenario.add_to(command, duration=5.0)
    shared.add_verbosity(command, "the files")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    if arguments.no_video and arguments.still is None:
        raise ValueError("--no-video leaves nothing to write: request a picture with --still")
    arguments.controller = arguments.controller or ["lqr"]
    out = arguments.output or Path(f"{'-'.join(Path(name).stem for name in arguments.controller)}.mp4")
    check_suffix(out)
    if out.suffix == ".png" and arguments.still is not None:
        raise ValueError(f"{out} are pictures of all frames: leave out --still")
    shown = scenario.trajectories(arguments)
    caption = not arguments.no_caption
    described = [_described(one) for one in shown]
    # The record of a single robot, or a list of the records of several, from left to right.
    report: dict[str, Any] = described[0] if len(shown) == 1 else {"shown": described}
    if arguments.still is not None:
        time = _moment(shown) if arguments.still is True else arguments.still
        samples = arguments.samples or STILL_SAMPLES
        renderers = [_renderer(one, arguments, samples) for one in shown]
        taken = side_by_side(shown, renderers, float(time), arguments.forces, caption, smooth=samples == 1)
        report["still"] = str(out.with_suffix(".png"))
        write_picture(taken, out.with_suffix(".png"))
    if not arguments.no_video:
        samples = arguments.samples or 1
        renderers = [_renderer(one, arguments, samples) for one in shown]
        with bar(f"rendering {out.name}", arguments.quiet or arguments.json) as progress:
            report["frames"] = write_video(
                shown,
                out,
                renderer=renderers,
                frame_rate=arguments.frame_rate,
                forces=arguments.forces,
                caption=caption,
                smooth=samples == 1,
                progress=progress,
            )
        report["video"] = str(out)
    if arguments.json:
        print(json.dumps(report, indent=2))
        return
    for one in shown:
        ending = f"upright for {one.times[-1]:.2f} s" if one.fell_at is None else f"fell at {one.fell_at:.2f} s"
        print(f"{one.controller} on {one.model}: {ending}")
    for kind in ("video", "still"):
        if kind in report:
            print(f"wrote {report[kind]}")


def _renderer(trajectory: Trajectory, arguments: argparse.Namespace, samples: int) -> Renderer:
    camera = {} if arguments.camera is None else dict(zip(("azimuth", "elevation"), arguments.camera, strict=True))
    if arguments.distance is not None:
        camera["distance"] = arguments.distance
    width, height = arguments.size
    return renderer_for(
        trajectory,
        schematic=arguments.schematic,
        width=width,
        height=height,
        samples=samples,
        camera=camera or None,
        urdf=arguments.urdf and tuple(arguments.urdf),
    )


def _described(trajectory: Trajectory) -> dict[str, Any]:
    return {
        "controller": trajectory.controller,
        "model": trajectory.model,
        "seconds": float(trajectory.times[-1]),
        "fell_at": trajectory.fell_at,
        "draws": {term: _last(rows) for term, rows in trajectory.draws.items()},
    }


def _moment(shown: Sequence[Trajectory]) -> float:
    """The time of the largest tilt of any robot: after the push if there is one, else after the first step.

    At the start itself the forces are not known yet.
    """
    latest = 0.0
    largest = -1.0
    for one in shown:
        after = max((push.time for push in one.all_pushes), default=0.0)
        tilts = np.where(one.times > after, one.of_states("tilt"), -1.0)
        if tilts.max() > largest:
            largest, latest = float(tilts.max()), float(one.times[tilts.argmax()])
    return latest


def _last(rows: npt.NDArray[np.float64]) -> Any:
    """The last row of draws, with null in place of NaN."""
    row = rows[-1].tolist()
    numbers = [None if math.isnan(number) else number for number in (row if isinstance(row, list) else [row])]
    return numbers if isinstance(row, list) else numbers[0]
