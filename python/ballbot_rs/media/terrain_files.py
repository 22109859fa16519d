"""Terrains as files for other programs: MJCF with a height field, PNG, STL."""

import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from ballbot_rs import _files
from ballbot_rs._checks import check_no_obstacles, check_real
from ballbot_rs._core import MOST_HEIGHTS, Terrain
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._reading import read_regular

#: Largest picture file, bytes: twice the size of the most heights in an uncompressed picture.
MAX_PICTURE: Final = 16 * MOST_HEIGHTS

#: Largest value of a 16-bit pixel.
_WHITE = 65535
#: Thickness of the ground under its lowest point, m.
_BASE = 0.1
#: A triangle of a binary STL.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@named
def write_terrain(terrain: Terrain, path: str | Path, cell: float | None = None) -> Path:
    """Writes the heights of a terrain on a grid; the suffix of the path selects the format.

    ```python
    bb.write_terrain(bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05), "bowl.stl")
    ```

    - `.xml`: MJCF of a world with a height field, whose heights are next to it in a file `.hf`.
    - `.png`: 16-bit gray, the first row at the largest y, black the least height and white the largest; both and
      the cell are in its text `ballbot`, which `read_terrain` reads.
    - `.stl`: triangles, in meters.

    Args:
        terrain: the terrain; not a plane, which has no edges.
        path: of the file.
        cell: largest distance between neighboring heights, m; None is the terrain's own. Other programs connect them
            by facets, on which a ball rolls less smoothly than here: docs/terrain.md.

    Raises:
        ValueError: a plane, obstacles, another suffix, or a cell that does not give a grid.
        OSError: the file cannot be written.
        ModuleNotFoundError: Pillow, for pictures, is not installed.
    """
    path = Path(path)
    writers = {".xml": _mjcf, ".png": _png, ".stl": _stl}
    if path.suffix not in writers:
        raise ValueError(f"{path}: a terrain is written as {', '.join(writers)}, not '{path.suffix}'")
    check_no_obstacles(terrain, f"the file {path}")
    heights, distance = terrain.heights(cell)
    writers[path.suffix](heights, distance, path)
    return path


@named
def read_terrain(path: str | Path, cell: float | None = None, height: float | None = None) -> Terrain:
    """The terrain of an 8-bit or 16-bit gray picture, its first row at the largest y.

    ```python
    bb.write_terrain(bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05), "bowl.png")
    print(bb.evaluate("lqr", terrain=bb.read_terrain("bowl.png"), episodes=3, max_episode_steps=50))
    ```

    Args:
        path: of the picture, of at most 4194304 pixels.
        cell: distance between neighboring pixels, m.
        height: of white above black, m. Both may be omitted for a picture of `write_terrain`; where both are given,
            black is at height 0.

    Raises:
        ValueError: not a picture, a picture that is not gray, is too large, or lacks `cell` and `height`; a surface
            that is too steep: smooth the steps of an 8-bit picture of noise first.
        OSError: the file cannot be read.
        ModuleNotFoundError: Pillow is not installed.
    """
    path = Path(path)
    lowest = 0.0
    try:
        pixels, text = _pixels(read_regular(path, MAX_PICTURE))
        if cell is None or height is None:
            facts = _facts(text)
            cell = facts["cell"] if cell is None else cell
            height = facts["height"] if height is None else height
            lowest = facts["lowest"]
        white = 255 if pixels.dtype == np.uint8 else _WHITE
        scale = check_real("height", height) / white
        if not math.isfinite(scale):
            raise InvalidInputError(f"height = {height} is out of range: it must be finite, m")
        return Terrain.from_heights(pixels[::-1].astype(np.float64) * scale + lowest, cell)
    except ValueError as error:
        raise InvalidInputError(f"{path}: {error}") from error


def _pixels(contents: bytes) -> tuple[npt.NDArray[Any], Any]:
    """Gray values of a picture, and its text `ballbot`, if any."""
    with require("reading a picture", "plot"):
        from PIL import Image
    try:
        # Reads only the header.
        with Image.open(io.BytesIO(contents)) as image:
            (columns, rows), mode = image.size, image.mode
            if columns * rows > MOST_HEIGHTS:
                raise InvalidInputError(f"the picture has {columns} x {rows} pixels, expected at most {MOST_HEIGHTS}")
            if mode not in ("L", "I;16"):
                gray = "heights need one gray value a pixel, L or I;16"
                raise InvalidInputError(f"the picture has the mode {mode}, but {gray}")
            return np.asarray(image), image.info.get("ballbot")
    except (InvalidInputError, MemoryError):
        raise
    except Image.DecompressionBombError as error:
        raise InvalidInputError(f"the picture is too large: expected at most {MOST_HEIGHTS} pixels") from error
    except Exception as error:
        # Decoders of other libraries may raise anything.
        raise InvalidInputError(f"not a picture that Pillow reads: {type(error).__name__}: {error}") from error


def _facts(text: Any) -> Mapping[str, float]:
    """The scale as `write_terrain` wrote it."""
    if text is None:
        raise InvalidInputError("a picture that write_terrain did not write needs cell and height, m")
    names = ("cell", "height", "lowest")
    try:
        facts = json.loads(text)
        return {name: check_real(name, facts[name]) for name in names}
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        expected = f"expected JSON of the numbers {', '.join(names)}, as write_terrain writes: give cell and height, m"
        raise InvalidInputError(f"the text 'ballbot' of the picture is not readable: {expected}") from error


def _mjcf(heights: npt.NDArray[np.float64], cell: float, path: Path) -> None:
    low, high = float(heights.min()), float(heights.max())
    rows, columns = heights.shape
    half = [0.5 * cell * (count - 1) for count in (columns, rows)]
    data = path.with_suffix(".hf")
    header = np.array([rows, columns], dtype="<i4").tobytes()
    # MuJoCo scales heights to 0 to 1 itself, and needs a thickness.
    thick = max(high - low, 1e-9)
    size = f"{half[0]:.17g} {half[1]:.17g} {thick:.17g} {_BASE}"
    _files.write(data, header + heights.astype("<f4").tobytes())
    text = f"""<mujoco>
  <asset><hfield name="terrain" file={quoteattr(data.name)} size="{size}"/></asset>
  <worldbody><geom name="terrain" type="hfield" hfield="terrain" pos="0 0 {low:.17g}"/></worldbody>
</mujoco>
"""
    _files.write(path, text)


def _png(heights: npt.NDArray[np.float64], cell: float, path: Path) -> None:
    with require("writing a picture", "plot"):
        from PIL import Image, PngImagePlugin
    low, high = float(heights.min()), float(heights.max())
    scale = _WHITE / (high - low) if high > low else 0.0
    pixels = np.rint((heights[::-1] - low) * scale).astype(np.uint16)
    facts = PngImagePlugin.PngInfo()
    facts.add_text("ballbot", json.dumps({"cell": cell, "lowest": low, "height": high - low}))
    with _files.replacing(path) as written:
        Image.fromarray(pixels).save(written, "PNG", pnginfo=facts)


def _stl(heights: npt.NDArray[np.float64], cell: float, path: Path) -> None:
    rows, columns = heights.shape
    x = cell * (np.arange(columns) - 0.5 * (columns - 1))
    y = cell * (np.arange(rows) - 0.5 * (rows - 1))
    places = np.stack([*np.meshgrid(x, y), heights], axis=-1)
    a, b, c, d = places[:-1, :-1], places[:-1, 1:], places[1:, 1:], places[1:, :-1]
    corners = np.stack([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)]).reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facets["corners"] = corners
    head = b"ballbot terrain, m".ljust(80) + np.uint32(len(facets)).tobytes()
    _files.write(path, head + facets.tobytes())
