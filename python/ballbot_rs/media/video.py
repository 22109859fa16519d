"""Pictures, videos and animations of a trajectory. Videos need moviepy, which brings ffmpeg along."""

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

#: Ends of the names of what `write_video` writes.
SUFFIXES = (".mp4", ".webp")


def renderer_for(trajectory: Trajectory, **options: Any) -> Renderer:
    """What takes the pictures; `options` as those of `Renderer`, which has 4 samples a pixel unless told."""
    robot = {} if options.get("urdf") else {"params": trajectory.params}
    return Renderer(**{**robot, "samples": 4, "terrain": trajectory.terrain, **options})


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
    """Writes a video (mp4, H.264) or an animation (WebP) that plays in real time; returns the number of its frames.

    Args:
        trajectory: what is shown.
        path: the file; its name ends in .mp4 or .webp.
        renderer: takes the pictures; width and height must be even for a video.
        frame_rate: frames a second.
        forces: whether arrows show the forces at the contacts.
        progress: told how many frames of how many are done.

    Raises:
        ModuleNotFoundError: moviepy, or Pillow for an animation, is not installed.
        ValueError: another suffix, an odd size, or a frame rate out of range.
        OSError: the video cannot be encoded or written; an earlier file stays as it is.
    """
    renderer = renderer or renderer_for(trajectory)
    check_suffix(path)
    lowest, highest = FRAME_RATES
    if not lowest <= frame_rate <= highest:
        raise ValueError(f"frame_rate = {frame_rate} is out of range: it must be from {lowest:g} to {highest:g}")
    total = frame_count(trajectory, frame_rate)
    if path.suffix == ".webp":
        shown = frames(trajectory, renderer, frame_rate, forces)
        _write_animation([_counted(frame, i, total, progress) for i, frame in enumerate(shown, 1)], path, frame_rate)
        return total
    if renderer.width % 2 or renderer.height % 2:
        raise ValueError(f"a video of {renderer.width}x{renderer.height} pixels: width and height must be even")
    with require("a video", "video"):
        from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
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


def check_suffix(path: Path) -> None:
    """Checks that a file's name is that of a video or an animation."""
    if path.suffix not in SUFFIXES:
        raise ValueError(f"{path}: the name of a video ends in .mp4, that of an animation in .webp")


def _counted(frame: Frames, done: int, total: int, progress: Progress) -> Frames:
    progress(done, total)
    return frame


def _write_animation(shown: list[Frames], path: Path, frame_rate: float) -> None:
    with require("an animation", "video"):
        from PIL import Image
    # Whole milliseconds that add up to the time of the frames.
    ends = np.round(np.arange(len(shown) + 1) * 1000.0 / frame_rate)
    first, *others = (Image.fromarray(frame) for frame in shown)
    drawn = io.BytesIO()
    durations = np.diff(ends).astype(int).tolist()
    first.save(drawn, "WEBP", save_all=True, append_images=others, duration=durations, quality=70, method=4)
    _files.write(path, drawn.getvalue())


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
