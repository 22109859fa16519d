"""Smooth edges of pictures with one sample per pixel: each pixel of an edge is blended along the edge."""

from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs.envs._render import Frames

#: Least range of brightness over a pixel and its neighbors that counts as an edge, and its fraction of the brightest.
LEAST, SHARE = 12.0, 1 / 8
#: Longest distance along the edge to each side, pixels; positions of the two samples between them, as fractions of it.
REACH, INNER = 6.0, 1 / 6
#: Keeps the direction finite where brightness hardly changes across the corners.
DAMPING: Final = 6.0


def smooth(frame: Frames) -> Frames:
    """The picture with blended edges; elsewhere it is unchanged."""
    height, width = frame.shape[:2]
    if min(height, width) < 3:
        return frame
    # Twice as much green as red and blue, in integers.
    bright = frame[..., 0].astype(np.int16) + 2 * frame[..., 1].astype(np.int16) + frame[..., 2]
    rows, columns = _edges(bright)
    if not len(rows):
        return frame
    corner = {(dy, dx): bright[rows + dy, columns + dx].astype(np.float32) / 4.0 for dy in (-1, 1) for dx in (-1, 1)}
    across_x = corner[-1, -1] + corner[1, -1] - corner[-1, 1] - corner[1, 1]
    across_y = corner[-1, -1] + corner[-1, 1] - corner[1, -1] - corner[1, 1]
    least = np.minimum(np.abs(across_x), np.abs(across_y)) + DAMPING
    along_x = np.clip(-across_y / least, -REACH, REACH)
    along_y = np.clip(across_x / least, -REACH, REACH)

    def sampled(share: float) -> npt.NDArray[np.float32]:
        return _between(frame, rows + share * along_y, columns + share * along_x)

    near = 0.5 * (sampled(-INNER) + sampled(INNER))
    wide = 0.5 * near + 0.25 * (sampled(-0.5) + sampled(0.5))
    # Values beyond the range of the neighbors come from another edge.
    around = np.stack([*corner.values(), bright[rows, columns].astype(np.float32) / 4.0])
    brightness = (wide[:, 0] + 2.0 * wide[:, 1] + wide[:, 2]) / 4.0
    within = (brightness >= around.min(axis=0)) & (brightness <= around.max(axis=0))
    smoothed: Frames = frame.copy()
    smoothed[rows, columns] = np.rint(np.where(within[:, np.newaxis], wide, near)).astype(np.uint8)
    return smoothed


def _edges(bright: npt.NDArray[np.int16]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns of the pixels at edges; none at the rim of the picture."""
    inner = bright[1:-1, 1:-1]
    high, low = inner.copy(), inner.copy()
    for neighbor in (bright[:-2, 1:-1], bright[2:, 1:-1], bright[1:-1, :-2], bright[1:-1, 2:]):
        np.maximum(high, neighbor, out=high)
        np.minimum(low, neighbor, out=low)
    rows, columns = np.nonzero(high - low > np.maximum(4.0 * LEAST, SHARE * high))
    return rows + 1, columns + 1


def _between(frame: Frames, rows: npt.NDArray[np.float32], columns: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Colors at places between pixels, shape (n, 3)."""
    height, width = frame.shape[:2]
    y, x = np.clip(rows, 0, height - 1.001), np.clip(columns, 0, width - 1.001)
    top, left = y.astype(np.intp), x.astype(np.intp)
    down, right = (y - top)[:, np.newaxis], (x - left)[:, np.newaxis]
    upper = (1 - right) * frame[top, left] + right * frame[top, left + 1]
    lower = (1 - right) * frame[top + 1, left] + right * frame[top + 1, left + 1]
    return ((1 - down) * upper + down * lower).astype(np.float32)
