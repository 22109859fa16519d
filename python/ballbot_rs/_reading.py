"""Reading of files named by a user or by a user's file."""

import os
import stat
from pathlib import Path
from typing import BinaryIO


def read_regular(path: Path, limit: int) -> bytes:
    """The contents of a regular file of at most `limit` bytes.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a regular file, or is larger.
    """
    with open_regular(path, limit) as file:
        contents = file.read(limit + 1)
    if len(contents) > limit:
        raise _too_large(path, limit)
    return contents


def open_regular(path: Path, limit: int) -> BinaryIO:
    """A regular file of at most `limit` bytes, to read: a device or a pipe may block, or never end.

    Raises:
        OSError: the file cannot be opened.
        ValueError: it is not a regular file, or is larger.
    """
    # Opening a pipe would block.
    file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115
    about = os.fstat(file.fileno())
    if stat.S_ISREG(about.st_mode) and about.st_size <= limit:
        return file
    file.close()
    raise _too_large(path, limit) if stat.S_ISREG(about.st_mode) else ValueError(f"{path} is not a regular file")


def _too_large(path: Path, limit: int) -> ValueError:
    return ValueError(f"{path} has more than {limit} bytes, the limit")


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
