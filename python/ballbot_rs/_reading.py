"""Reading of files named by a user or by a user's file."""

import os
import stat
from pathlib import Path


def read_regular(path: Path, limit: int) -> bytes:
    """The contents of a regular file of at most `limit` bytes: a device or a pipe may block, or never end.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a regular file, or is larger.
    """
    # Opening a pipe would block.
    with open(path, "rb", opener=_open_at_once) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError(f"{path} is not a regular file")
        contents = file.read(limit + 1)
    if len(contents) > limit:
        raise ValueError(f"{path} has more than {limit} bytes, the limit")
    return contents


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
