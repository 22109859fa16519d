"""Columns of numbers from CSV and npz files."""

import array
import csv
import io
import zlib
from collections.abc import Collection
from typing import IO, Any, Final
from zipfile import BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError

#: Numbers of any type.
Column = npt.NDArray[Any]

#: Largest log file, bytes: an hour at 1 kHz with all columns.
MAX_LOG_FILE: Final = 1 << 30

#: Exceptions of NumPy and the archive for broken files.
_UNREADABLE: Final = (
    OSError,
    EOFError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    RuntimeError,
    BadZipFile,
    zlib.error,
)


def csv_columns(file: IO[bytes], known: Collection[str], blanks: bool = False) -> dict[str, Column]:
    """Columns of a CSV file with a header by name; columns that are not `known` are empty.

    Args:
        file: read row by row.
        known: names of the columns to read.
        blanks: whether a cell may be empty; it becomes NaN.

    Raises:
        ValueError: a repeated name, a row of another length, or a cell that is not a number.
    """
    rows = csv.reader(io.TextIOWrapper(file, "utf-8-sig", newline=""))
    header = [title.strip() for title in next(rows, [])]
    if len(set(header)) < len(header):
        raise InvalidInputError(f"two columns have one name: {', '.join(header)}")
    kept = [(place, array.array("d")) for place, title in enumerate(header) if title in known]
    for count, row in enumerate(rows):
        if not row:
            continue
        if len(row) != len(header):
            raise InvalidInputError(f"row {count} has {len(row)} cells, the header has {len(header)}")
        for place, numbers in kept:
            text = row[place]
            try:
                numbers.append(float(text))
            except ValueError:
                if not blanks or text.strip():
                    raise InvalidInputError(f"{header[place]} of row {count} is '{text}', not a number") from None
                numbers.append(np.nan)
    return {**dict.fromkeys(header, np.zeros(0)), **{header[place]: np.asarray(numbers) for place, numbers in kept}}


def npz_columns(contents: bytes, known: Collection[str]) -> dict[str, Column]:
    """Arrays of an npz file by name; arrays that are not `known` are empty.

    Raises:
        ValueError: not an npz file, an array that is not one row of numbers, or too many numbers.
    """
    try:
        with ZipFile(io.BytesIO(contents)) as archive:
            names = {name.removesuffix(".npy"): name for name in archive.namelist()}
            found = dict.fromkeys(names, np.zeros(0))
            read = [name for name in names if name in known]
            # A few bytes can unpack to, or claim to be, any number of rows.
            rows = {}
            for name in read:
                with archive.open(names[name]) as member:
                    rows[name] = _npy_rows(name, member)
            if (total := sum(rows.values())) > MAX_LOG_FILE:
                raise InvalidInputError(f"the columns have {total} bytes, the limit is {MAX_LOG_FILE}")
            for name in read:
                with archive.open(names[name]) as member:
                    found[name] = np.lib.format.read_array(member, allow_pickle=False)
    except InvalidInputError:
        raise
    except _UNREADABLE as error:
        raise InvalidInputError(f"not an npz file: {error}") from error
    return found


def _npy_rows(name: str, member: IO[bytes]) -> int:
    """Bytes of one row of numbers, from the header of its file."""
    version = np.lib.format.read_magic(member)
    # Later versions are for names of fields, which plain numbers do not have.
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
    shape, _, dtype = read(member)
    if dtype.kind not in "fiu" or len(shape) != 1:
        raise InvalidInputError(f"{name} is of type {dtype} with shape {shape}, not one row of numbers")
    return int(shape[0]) * int(dtype.itemsize)
