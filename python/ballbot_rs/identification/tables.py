"""Columns of numbers from CSV and npz files."""

import csv
import io
import zlib
from collections.abc import Collection
from typing import IO, Final
from zipfile import BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError

Array = npt.NDArray[np.float64]

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


def csv_columns(contents: bytes, known: Collection[str], blanks: bool = False) -> dict[str, Array]:
    """Columns of a CSV file with a header by name; columns that are not `known` are empty.

    Args:
        contents: of the file.
        known: names of the columns to read.
        blanks: whether a cell may be empty; it becomes NaN.

    Raises:
        ValueError: a repeated name, a row of another length, or a cell that is not a number.
    """
    rows = csv.reader(io.StringIO(contents.decode("utf-8-sig"), newline=""))
    header = [title.strip() for title in next(rows, [])]
    if len(set(header)) < len(header):
        raise InvalidInputError(f"two columns have one name: {', '.join(header)}")
    kept = [(place, title) for place, title in enumerate(header) if title in known]
    numbers: list[list[float]] = []
    for count, row in enumerate(rows):
        if not row:
            continue
        if len(row) != len(header):
            raise InvalidInputError(f"row {count} has {len(row)} cells, the header has {len(header)}")
        try:
            numbers.append([_number(row[place], blanks) for place, _ in kept])
        except ValueError:
            place, title = next(one for one in kept if not _is_number(row[one[0]], blanks))
            raise InvalidInputError(f"{title} of row {count} is '{row[place]}', not a number") from None
    values = np.array(numbers, dtype=np.float64).reshape(len(numbers), len(kept))
    return {**dict.fromkeys(header, np.zeros(0)), **{title: values[:, i] for i, (_, title) in enumerate(kept)}}


def npz_columns(contents: bytes, known: Collection[str]) -> dict[str, Array]:
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


def _number(text: str, blanks: bool) -> float:
    return np.nan if blanks and not text.strip() else float(text)


def _is_number(text: str, blanks: bool) -> bool:
    try:
        _number(text, blanks)
    except ValueError:
        return False
    return True


def _npy_rows(name: str, member: IO[bytes]) -> int:
    """Bytes of one row of numbers, from the header of its file."""
    version = np.lib.format.read_magic(member)
    # Later versions are for names of fields, which plain numbers do not have.
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
    shape, _, dtype = read(member)
    if dtype.kind not in "fiu" or len(shape) != 1:
        raise InvalidInputError(f"{name} is of type {dtype} with shape {shape}, not one row of numbers")
    return int(shape[0]) * int(dtype.itemsize)
