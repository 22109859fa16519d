"""Pictures, videos and animations of a trajectory. Videos need moviepy, which includes ffmpeg."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_rs import _assets, _files
from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Params, Renderer
from ballbot_rs._extras import require
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.envs._render import GEOMETRY, Frames
from ballbot_rs.media.animation import FASTEST_GIF, check_numbered, write_animation, write_pictures
from ballbot_rs.media.arrows import arrows
from ballbot_rs.media.caption import lines
from ballbot_rs.media.caption import write as write_caption
from ballbot_rs.media.robot_files import write_urdf
from ballbot_rs.media.shapes import published
from ballbot_rs.media.smoothing import smooth as smooth_edges

#: Lowest and highest frame rate, 1/s.
FRAME_RATES = (1.0, 240.0)

#: Suffixes of the files that `write_video` writes.
SUFFIXES = (".mp4", ".webp", ".gif", ".png")


def renderer_for(trajectory: Trajectory, *, schematic: bool = False, **options: Any) -> Renderer:
    """The renderer of a trajectory.

    Args:
        trajectory: what is shown.
        schematic: plain shapes from the parameters, which take a third of the time of meshes. Otherwise a robot with
            the geometry of `assets/bot.urdf` is shown with the meshes of that file, and a published robot with the
            shapes of `write_urdf`.
        options: as in `Renderer`.
    """
    given = {"terrain": trajectory.terrain, **options}
    if given.get("urdf") is None:
        given.pop("urdf", None)
        if not schematic and has_meshes(trajectory.params):
            given["urdf"] = (_assets.path("bot.urdf"), _assets.path("ball.urdf"))
        elif not schematic and published(trajectory.params) is not None:
            return _of_shapes(trajectory.params, given)
        else:
            given["robot"] = trajectory.params
    return Renderer(**given)


def _of_shapes(params: Params, options: dict[str, Any]) -> Renderer:
    with _files.scratch_folder() as folder:
        bot, ball = (write_urdf(params, folder / f"{part}.urdf", part=part) for part in ("bot", "ball"))
        return Renderer(urdf=(bot, ball), **options)


def has_meshes(params: Params) -> bool:
    """Whether the meshes that come with the package fit a robot."""
    paper = Params.paper()
    return all(np.allclose(getattr(params, name), getattr(paper, name), rtol=1e-3) for name in GEOMETRY)


def picture(
    trajectory: Trajectory,
    renderer: Renderer,
    time: float,
    forces: bool = False,
    caption: bool = True,
    smooth: bool = True,
) -> Frames:
    """The robot at the row nearest to a time.

    Args:
        trajectory: what is shown.
        renderer: renders the picture.
        time: s.
        forces: whether arrows show the forces at the contacts.
        caption: whether the picture has its caption; pushes and commands are shown in any case.
        smooth: whether edges are blended, for renderers with one sample a pixel.

    Raises:
        ValueError: a time outside the trajectory.
        ModuleNotFoundError: Pillow, which a caption needs, is not installed.
    """
    return _taken(trajectory, renderer, time, forces, caption, smooth)()


def _taken(
    trajectory: Trajectory, renderer: Renderer, time: float, forces: bool, caption: bool, smooth: bool
) -> Callable[[], Frames]:
    """As `picture`, rendered; the call finishes it."""
    _check_time(time, float(trajectory.times[-1]))
    row = int(np.abs(trajectory.times - time).argmin())
    contacts = trajectory.contacts[row] if forces else None
    frame = renderer.render(trajectory.states[row], contacts, arrows(trajectory, row))

    def finish() -> Frames:
        smoothed = smooth_edges(frame) if smooth else frame
        return write_caption(smoothed, lines(trajectory, row)) if caption else smoothed

    return finish


def side_by_side(
    shown: Sequence[Trajectory],
    renderers: Sequence[Renderer],
    time: float,
    forces: bool = False,
    caption: bool = True,
    smooth: bool = True,
) -> Frames:
    """Pictures of several trajectories at one time, from left to right; a trajectory that ended stays at its end.

    Raises:
        ValueError: a time outside all trajectories.
    """
    return _all_taken(shown, renderers, time, forces, caption, smooth)()


def _all_taken(
    shown: Sequence[Trajectory],
    renderers: Sequence[Renderer],
    time: float,
    forces: bool,
    caption: bool,
    smooth: bool,
) -> Callable[[], Frames]:
    """As `side_by_side`, rendered; the call finishes it."""
    _check_time(time, _end(shown))
    taken = [
        _taken(one, renderer, min(time, float(one.times[-1])), forces, caption, smooth)
        for one, renderer in zip(shown, renderers, strict=True)
    ]
    return lambda: np.concatenate([finish() for finish in taken], axis=1)


def _finished(taken: Iterator[Callable[[], Frames]]) -> Iterator[Frames]:
    """The pictures in their order; a thread finishes each while the next one is rendered."""
    with ThreadPoolExecutor(1) as pool:
        last: Future[Frames] | None = None
        for finish in taken:
            finishing = pool.submit(finish)
            if last is not None:
                yield last.result()
            last = finishing
        if last is not None:
            yield last.result()


def _check_time(time: float, end: float) -> None:
    if not 0.0 <= time <= end + 1e-9:
        raise ValueError(f"there is no picture at {time} s: the trajectory is from 0 to {end:.2f} s")


def frame_count(shown: Trajectory | Sequence[Trajectory], frame_rate: float) -> int:
    """Number of frames of a video that plays in real time."""
    return max(round(_end(_several(shown)) * frame_rate), 1)


def write_video(
    trajectory: Trajectory | Sequence[Trajectory],
    path: Path,
    *,
    renderer: Renderer | Sequence[Renderer] | None = None,
    frame_rate: float = 50.0,
    forces: bool = False,
    caption: bool = True,
    smooth: bool = True,
    progress: Progress = no_progress,
) -> int:
    """Writes a video (mp4, H.264), an animation (WebP, GIF) that plays in real time, or its frames (PNG).

    Pushes and the task's command are shown as arrows. Returns the number of frames.

    Args:
        trajectory: the trajectory to show, or several side by side.
        path: the file; its name ends in .mp4, .webp or .gif, or, for frames with their numbers, in %04d.png.
        renderer: renders the pictures, one for each trajectory; width and height must be even for a video.
        frame_rate: frames per second.
        forces: whether arrows show the forces at the contacts.
        caption: whether pictures show controller, model, time and tilt in their corner.
        smooth: as in `picture`.
        progress: called with the number of frames done and their total.

    Raises:
        ModuleNotFoundError: moviepy, or Pillow for an animation or a caption, is not installed.
        ValueError: no trajectory, another suffix, an odd size, a frame rate out of range, or a number of renderers
            other than the number of trajectories.
        OSError: the video cannot be encoded or written; an earlier file stays as it is.
    """
    check_suffix(path)
    check_bounded("frame_rate", frame_rate, *FRAME_RATES)
    if path.suffix == ".gif" and frame_rate > FASTEST_GIF:
        raise ValueError(f"frame_rate = {frame_rate:g} is out of range for a GIF: it must be at most {FASTEST_GIF:g}")
    shown = _several(trajectory)
    renderers = _renderers(shown, renderer)
    total = frame_count(shown, frame_rate)
    times = (min(i / frame_rate, _end(shown)) for i in range(total))
    frames = _finished(_all_taken(shown, renderers, time, forces, caption, smooth) for time in times)
    if path.suffix != ".mp4":
        counted = _counted(frames, total, progress)
        if path.suffix == ".png":
            write_pictures(counted, path)
        else:
            write_animation(counted, path, frame_rate)
        return total
    width, height = sum(one.width for one in renderers), renderers[0].height
    if width % 2 or height % 2:
        raise ValueError(f"a video of {width}x{height} pixels: width and height must be even")
    with require("a video", "video"):
        from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
    # Only half-resolution color plays in every browser.
    options = {"pixel_format": "yuv420p", "preset": "medium"}
    with (
        _files.replacing(path) as temporary,
        FFMPEG_VideoWriter(str(temporary), (width, height), frame_rate, "libx264", **options) as writer,
    ):
        try:
            for done, frame in enumerate(frames, 1):
                writer.write_frame(frame)
                progress(done, total)
        except OSError as error:
            raise _failure(str(error)) from error
        # This closes the encoder's input, which signals the end.
        _, output = writer.proc.communicate()
        if writer.proc.returncode != 0:
            raise _failure(output.decode("utf-8", "replace"))
    return total


def _several(shown: Trajectory | Sequence[Trajectory]) -> Sequence[Trajectory]:
    several = [shown] if isinstance(shown, Trajectory) else shown
    if not several:
        raise ValueError("a video shows at least one trajectory")
    return several


def _renderers(shown: Sequence[Trajectory], given: Renderer | Sequence[Renderer] | None) -> Sequence[Renderer]:
    if given is None:
        return [renderer_for(one) for one in shown]
    renderers = [given] if isinstance(given, Renderer) else given
    if len(renderers) != len(shown):
        raise ValueError(f"there are {len(renderers)} renderers for {len(shown)} trajectories: give one for each")
    if len({one.height for one in renderers}) > 1:
        raise ValueError("pictures side by side must have the same height")
    return renderers


def _end(shown: Sequence[Trajectory]) -> float:
    return max(float(one.times[-1]) for one in shown)


def check_suffix(path: Path) -> None:
    """Checks that a file's name is the name of a video, an animation or numbered pictures."""
    if path.suffix not in SUFFIXES:
        raise ValueError(f"{path}: a video ends in .mp4, an animation in .webp or .gif, frames in .png")
    if path.suffix == ".png":
        check_numbered(path)


def _counted(frames: Iterator[Frames], total: int, progress: Progress) -> Iterator[Frames]:
    for done, frame in enumerate(frames, 1):
        progress(done, total)
        yield frame


def _failure(output: str) -> OSError:
    """The encoder's last message; the lines before it are only progress."""
    lines = output.strip().splitlines() or ["it ended without a message"]
    return OSError(f"the video encoder failed: {lines[-1].strip()}")
