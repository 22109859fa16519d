"""Files and tables of a trajectory: CSV, NPZ, MCAP, Parquet and pandas, with the columns of `columns`, and a replay.

Quaternions are (w, x, y, z), except in the transforms of an MCAP file, whose format names the components.
"""

import io
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ballbot_rs import _files
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs._mcap import NUMBER, McapWriter, object_schema
from ballbot_rs.analysis.columns import Array, Quantity, columns, quantities

if TYPE_CHECKING:
    from ballbot_rs.analysis.trajectory import Trajectory

#: Robots in the tree of frames: name, attributes of the state for position and attitude.
_FRAMES: Final = (("ball", "ball_position", "ball_quaternion"), ("body", "body_position", "body_quaternion"))


def to_csv(trajectory: "Trajectory", path: str | PathLike[str]) -> None:
    """Writes a table, its header in the first row; numbers read back bit for bit."""
    write_csv(columns(trajectory), path)


def to_npz(trajectory: "Trajectory", path: str | PathLike[str]) -> None:
    """Writes a compressed NumPy archive, one array per column."""
    write_npz(columns(trajectory), path)


def write_csv(table: Mapping[str, Array], path: str | PathLike[str]) -> None:
    """Columns as CSV, as `to_csv`."""
    rows = zip(*(values.tolist() for values in table.values()), strict=True)
    lines = [",".join(table), *(",".join(map(str, row)) for row in rows)]
    _files.write(_path(path, ".csv"), "\n".join(lines) + "\n")


def write_npz(table: Mapping[str, Array], path: str | PathLike[str]) -> None:
    """Columns as NPZ, as `to_npz`."""
    packed = io.BytesIO()
    np.savez_compressed(packed, **table)  # type: ignore[arg-type]
    _files.write(_path(path, ".npz"), packed.getvalue())


def to_parquet(trajectory: "Trajectory", path: str | PathLike[str]) -> None:
    """Writes a table with the metadata of `to_mcap`.

    Raises:
        ModuleNotFoundError: pyarrow is not installed.
    """
    file = _path(path, ".parquet")
    with require("a Parquet file", "parquet"):
        import pyarrow
        import pyarrow.parquet
    packed = io.BytesIO()
    table = pyarrow.table(dict(columns(trajectory)))
    pyarrow.parquet.write_table(table.replace_schema_metadata(_metadata(trajectory)), packed)
    _files.write(file, packed.getvalue())


def to_dataframe(trajectory: "Trajectory") -> Any:
    """A `pandas.DataFrame` of the columns.

    Raises:
        ModuleNotFoundError: pandas is not installed.
    """
    with require("a DataFrame", "pandas"):
        import pandas as pd
    return pd.DataFrame(columns(trajectory))


def to_mcap(trajectory: "Trajectory", path: str | PathLike[str]) -> None:
    """Writes an MCAP log with JSON messages: one topic per group of quantities, and `/tf` with ball and body.

    Raises:
        ModuleNotFoundError: mcap is not installed.
    """
    file = _path(path, ".mcap")
    packed = io.BytesIO()
    writer = McapWriter(packed)
    groups: dict[str, list[Quantity]] = {}
    for quantity in quantities(trajectory):
        groups.setdefault(quantity.group, []).append(quantity)
    channels = {group: writer.channel(f"/{group}", f"ballbot.{group}", _schema(of)) for group, of in groups.items()}
    frames = writer.channel("/tf", "foxglove.FrameTransforms", _TRANSFORMS)
    for row, time in enumerate(trajectory.times):
        nanoseconds = round(float(time) * 1e9)
        for group, of in groups.items():
            message = {quantity.name: _value(quantity, row) for quantity in of}
            message = {name: value for name, value in message.items() if value is not None}
            if message:
                writer.add(channels[group], nanoseconds, message)
        writer.add(frames, nanoseconds, _transforms(trajectory, row, nanoseconds))
    writer.finish(_metadata(trajectory))
    _files.write(file, packed.getvalue())


def to_html(
    trajectory: "Trajectory",
    path: str | PathLike[str],
    *,
    frame_rate: float = 60.0,
    forces: bool = False,
    dark: bool = False,
) -> None:
    """Writes a replay in 3D; arguments as in `Trajectory.to_html`.

    Raises:
        ModuleNotFoundError: viser is not installed.
    """
    file = _path(path, ".html")
    with require("a replay", "view"):
        from ballbot_rs.viewer.replay.file import write
    write(trajectory, file, frame_rate=frame_rate, forces=forces, dark=dark)


#: Writers by the suffixes of their files.
FORMATS: Final[Mapping[str, Callable[["Trajectory", Path], None]]] = {
    ".csv": to_csv,
    ".npz": to_npz,
    ".mcap": to_mcap,
    ".parquet": to_parquet,
    ".html": to_html,
}


def format_of(path: str | PathLike[str]) -> Callable[["Trajectory", Path], None]:
    """The writer of a file.

    Raises:
        ValueError: a suffix that is not in `FORMATS`.
    """
    suffix = Path(path).suffix
    if suffix not in FORMATS:
        raise InvalidInputError(f"{path}: the name of the file must end in {', '.join(FORMATS)}")
    return FORMATS[suffix]


def _metadata(trajectory: "Trajectory") -> dict[str, str]:
    return {
        "controller": trajectory.controller,
        "model": trajectory.model,
        "params": trajectory.params.to_toml(),
        "fell_at": "" if trajectory.fell_at is None else repr(trajectory.fell_at),
    }


def _path(path: str | PathLike[str], suffix: str) -> Path:
    file = Path(path)
    if file.suffix != suffix:
        raise InvalidInputError(f"{file}: the name of the file must end in {suffix}")
    return file


def _schema(of: list[Quantity]) -> dict[str, Any]:
    properties = {}
    for quantity in of:
        doc = f"{quantity.doc}, {quantity.unit}" if quantity.unit else quantity.doc
        if quantity.axes:
            properties[quantity.name] = object_schema(dict.fromkeys(quantity.axes, NUMBER), description=doc)
        else:
            properties[quantity.name] = {**NUMBER, "description": doc}
    return object_schema(properties)


def _value(quantity: Quantity, row: int) -> Any:
    """The value of a quantity in a message; None where it is missing."""
    numbers: Array = quantity.values[row]
    if not np.isfinite(numbers).all():
        return None
    values = numbers.tolist()
    return dict(zip(quantity.axes, values, strict=True)) if quantity.axes else values[0]


_TIME: Final = object_schema({"sec": {"type": "integer"}, "nsec": {"type": "integer"}}, title="time")
_TRANSFORMS: Final = object_schema(
    {
        "transforms": {
            "type": "array",
            "items": object_schema(
                {
                    "timestamp": _TIME,
                    "parent_frame_id": {"type": "string"},
                    "child_frame_id": {"type": "string"},
                    "translation": object_schema(dict.fromkeys("xyz", NUMBER)),
                    "rotation": object_schema(dict.fromkeys("xyzw", NUMBER)),
                }
            ),
        }
    },
    title="foxglove.FrameTransforms",
)


def _transforms(trajectory: "Trajectory", row: int, nanoseconds: int) -> dict[str, Any]:
    seconds, rest = divmod(nanoseconds, 10**9)
    state = trajectory.states[row]
    return {
        "transforms": [
            {
                "timestamp": {"sec": seconds, "nsec": rest},
                "parent_frame_id": "world",
                "child_frame_id": name,
                "translation": dict(zip("xyz", getattr(state, position).tolist(), strict=True)),
                "rotation": dict(zip("wxyz", getattr(state, attitude).tolist(), strict=True)),
            }
            for name, position, attitude in _FRAMES
        ]
    }
