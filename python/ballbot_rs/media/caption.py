"""Text in the upper left corner of a picture: controller, model, time, tilt, pushes. Needs Pillow."""

import functools
from typing import Any, Final

import numpy as np

from ballbot_rs._extras import require
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.envs._render import Frames
from ballbot_rs.media.arrows import pulled, pushed
from ballbot_rs.media.figures.labels import short

INK, HALO, ALERT = (33, 37, 41), (255, 255, 255), (201, 42, 42)
#: Font size as a fraction of the picture's height, and the minimum, pixels.
SHARE, LEAST = 1 / 26, 9
#: Lines: the first names the controller, the second has numbers, the third events.
SPACING: Final = 1.35


def lines(trajectory: Trajectory, row: int) -> list[str]:
    """The caption at a row; the last of three lines is for a push, a force or a fall."""
    time = float(trajectory.times[row])
    tilt = np.degrees(trajectory.states[row].tilt)
    caption = [f"{short(trajectory.controller)} on {trajectory.model}", f"{time:.2f} s   tilt {tilt:.1f}°"]
    if trajectory.fell_at is not None and time >= trajectory.fell_at:
        caption.append(f"fell at {trajectory.fell_at:.2f} s")
    else:
        loads = [f"push {np.linalg.norm(vector):.3g} N·s" for vector, _ in pushed(trajectory, time)]
        loads += [f"force {np.linalg.norm(vector):.3g} N" for vector, _ in pulled(trajectory, time)]
        caption += [", ".join(loads)] if loads else []
    return caption


def write(frame: Frames, caption: list[str]) -> Frames:
    """The picture with lines of text; the third is red."""
    with require("a caption", "video"):
        from PIL import Image, ImageDraw
    image = Image.fromarray(frame)
    size = max(round(frame.shape[0] * SHARE), LEAST)
    draw = ImageDraw.Draw(image)
    for i, text in enumerate(caption):
        color = ALERT if i == 2 else INK
        place = (0.7 * size, (0.5 + SPACING * i) * size)
        draw.text(place, text, font=_font(size), fill=color, stroke_width=max(size // 9, 1), stroke_fill=HALO)
    return np.asarray(image)


@functools.cache
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)
