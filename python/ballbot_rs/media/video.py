"""Pictures and videos of a trajectory. Videos need moviepy, which brings ffmpeg along."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_rs import _files
from ballbot_rs._core import Renderer
from ballbot_rs._extras import require
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.envs._render import Frames

#: Lowest and highest number of frames a second.
FRAME_RATES = (1.0, 240.0)


def renderer_for(trajectory: Trajectory, **options: Any) -> Renderer:
    """What takes the pictures; `options` as those of `Renderer`, which has 4 samples a pixel unless told."""
    return Renderer(trajectory.params, **{"samples": 4, "terrain": trajectory.terrain, **options})


def picture(trajectory: Trajectory, renderer: Renderer, time: float, forces: bool = False) -> Frames:
    """The robot at the row nearest to a time.

    Raises:
        ValueError: a time outside the trajectory.
    """
    end = trajectory.times[-1]
    if not 0.0 <= time <= end + 1e-9:
        raise ValueError(f"there is no picture at {time} s: the trajectory is from 0 to {end:.2f} s")
    row = int(np.abs(trajectory.times - time).argmin())
    return renderer.render(trajectory.states[row], trajectory.contacts[row] if forces else None)


def frames(trajectory: Trajectory, renderer: Renderer, frame_rate: float, forces: bool = False) -> Iterator[Frames]:
    """Pictures at a rate, from the start to the end."""
    for i in range(frame_count(trajectory, frame_rate)):
        yield picture(trajectory, renderer, min(i / frame_rate, trajectory.times[-1]), forces)


def frame_count(trajectory: Trajectory, frame_rate: float) -> int:
    """How many pictures a video has: as many as show each moment for its time."""
    return max(round(float(trajectory.times[-1]) * frame_rate), 1)


def write_video(
    trajectory: Trajectory,
    path: Path,
    *,
    renderer: Renderer | None = None,
    frame_rate: float = 50.0,
    forces: bool = False,
    progress: Progress = no_progress,
) -> int:
    """Writes an mp4 (H.264) that plays in real time; returns the number of its frames.

    Args:
        trajectory: what is shown.
        path: the file; its name ends in .mp4.
        renderer: takes the pictures; width and height must be even.
        frame_rate: frames a second.
        forces: whether arrows show the forces at the contacts.
        progress: told how many frames of how many are done.

    Raises:
        ModuleNotFoundError: moviepy is not installed.
        ValueError: another suffix, an odd size, or a frame rate out of range.
        OSError: the video cannot be encoded or written; an earlier file stays as it is.
    """
    renderer = renderer or renderer_for(trajectory)
    if path.suffix != ".mp4":
        raise ValueError(f"{path}: the name of a video ends in .mp4")
    lowest, highest = FRAME_RATES
    if not lowest <= frame_rate <= highest:
        raise ValueError(f"frame_rate = {frame_rate} is out of range: it must be from {lowest:g} to {highest:g}")
    if renderer.width % 2 or renderer.height % 2:
        raise ValueError(f"a video of {renderer.width}x{renderer.height} pixels: width and height must be even")
    with require("a video", "video"):
        from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
    total = frame_count(trajectory, frame_rate)
    # Only colors at half the resolution play in every browser.
    size = (renderer.width, renderer.height)
    options = {"pixel_format": "yuv420p", "preset": "medium"}
    with (
        _files.replacing(path) as beside,
        FFMPEG_VideoWriter(str(beside), size, frame_rate, "libx264", **options) as writer,
    ):
        try:
            for done, frame in enumerate(frames(trajectory, renderer, frame_rate, forces), 1):
                writer.write_frame(frame)
                progress(done, total)
        except OSError as error:
            raise _failure(str(error)) from error
        # This closes the encoder's input, which is how it learns of the end.
        _, said = writer.proc.communicate()
        if writer.proc.returncode != 0:
            raise _failure(said.decode("utf-8", "replace"))
    return total


def _failure(said: str) -> OSError:
    """What the encoder said last; the lines before it are its way there."""
    lines = said.strip().splitlines() or ["it ended without a message"]
    return OSError(f"the video encoder failed: {lines[-1].strip()}")


def write_picture(frame: Frames, path: Path) -> None:
    """Writes a frame as a PNG.

    Raises:
        ModuleNotFoundError: Pillow, which comes with moviepy and matplotlib, is not installed.
        ValueError: another suffix.
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    if path.suffix != ".png":
        raise ValueError(f"{path}: the name of a picture ends in .png")
    with require("a picture", "video"):
        from PIL import Image
    drawn = io.BytesIO()
    Image.fromarray(frame).save(drawn, "PNG", optimize=True)
    _files.write(path, drawn.getvalue())
