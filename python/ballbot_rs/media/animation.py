"""Frames as an animation in one file, WebP or GIF, or as numbered pictures."""

import io
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from ballbot_rs import _files
from ballbot_rs._extras import require
from ballbot_rs.envs._render import Frames

#: Highest frame rate of a GIF, 1/s: browsers show shorter frames for a tenth of a second.
FASTEST_GIF: Final = 50.0

#: A number in the name of a picture, as `printf` writes it.
_NUMBERED: Final = re.compile(r"[^%]*%(0\d)?d[^%]*")

#: Resolution of the times of frames, ms.
_RESOLUTION: Final = {".webp": 1, ".gif": 10}


def check_numbered(path: Path) -> None:
    """Checks that the name of pictures has a place for their numbers.

    Raises:
        ValueError: it has none.
    """
    if not _NUMBERED.fullmatch(path.name):
        raise ValueError(f"{path}: frames have numbers in their names, as {path.stem.replace('%', '')}-%04d.png")


def write_animation(frames: Iterable[Frames], path: Path, frame_rate: float) -> None:
    """Writes frames as WebP or GIF, by the suffix of `path`; it repeats forever.

    Raises:
        ModuleNotFoundError: Pillow is not installed.
        OSError: the file cannot be written; an earlier one stays as it is.
    """
    with require("an animation", "video"):
        from PIL import Image
    first, *others = (Image.fromarray(frame) for frame in frames)
    # Whole steps of the format that add up to the time of the frames.
    step = _RESOLUTION[path.suffix]
    ends = step * np.round(np.arange(len(others) + 2) * 1000.0 / (step * frame_rate))
    durations = np.diff(ends).astype(int).tolist()
    options: dict[str, Any] = {
        "save_all": True,
        "append_images": others,
        "duration": durations,
    }
    drawn = io.BytesIO()
    if path.suffix == ".gif":
        first.save(drawn, "GIF", loop=0, **options)
    else:
        first.save(drawn, "WEBP", quality=70, method=4, **options)
    _files.write(path, drawn.getvalue())


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


def write_pictures(frames: Iterable[Frames], path: Path) -> None:
    """Writes frames as PNGs, whose numbers begin with 0; `path` has the place of the number, as `frame-%04d.png`.

    Raises:
        ModuleNotFoundError, OSError: as `write_picture`.
    """
    for number, frame in enumerate(frames):
        write_picture(frame, path.with_name(path.name % number))
