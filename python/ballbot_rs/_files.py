"""Files are written next to their target, then moved over it: a crash or a full disk leaves the old file intact."""

import contextlib
import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

#: Part of the name of an unfinished file.
PARTIAL = ".partial"

#: Files being written, and scratch folders. Code that ends the process without unwinding deletes them.
_unfinished: set[Path] = set()


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A context that yields the path of a file to write; at its end that file replaces `path`.

    The file has the suffix of `path` and is in the same folder, which is made if needed. After an error it is
    deleted, and `path` is unchanged.

    Raises:
        OSError: the file cannot be written or moved; its `filename` is `path`.
    """
    target = path.resolve() if path.is_symlink() else path
    temporary = target.with_name(f".{target.stem[:100]}.{os.getpid()}{PARTIAL}{target.suffix[:20]}")
    try:
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            raise OSError(errno.EEXIST, "it already exists and is not a regular file")
        target.parent.mkdir(parents=True, exist_ok=True)
        _unfinished.add(temporary)
        yield temporary
        with temporary.open("r+b") as written:
            os.fsync(written.fileno())
        temporary.replace(target)
        _sync_folder(target.parent)
    except OSError as error:
        raise OSError(error.errno or errno.EIO, f"not written: {error.strerror or error}", str(path)) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        _unfinished.discard(temporary)


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A context with an empty folder for temporary files, which is deleted at its end."""
    with tempfile.TemporaryDirectory(prefix="ballbot-") as name:
        folder = Path(name)
        _unfinished.add(folder)
        try:
            yield folder
        finally:
            _unfinished.discard(folder)


def write(path: Path, content: bytes | str) -> None:
    """Writes a whole file, text as UTF-8.

    Raises:
        OSError: as `replacing`.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


def delete_unfinished() -> None:
    """Deletes the unfinished files of this process."""
    for path in list(_unfinished):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def is_remains(path: Path) -> bool:
    """Whether a process ended and left this file unfinished."""
    before, found, _ = path.name.rpartition(PARTIAL)
    number = before.rpartition(".")[2]
    return bool(found) and path.name.startswith(".") and number.isdecimal() and not _is_running(int(number))


def delete_remains(folder: Path) -> None:
    """Deletes unfinished files that a killed process left in a folder."""
    for path in folder.glob(f".*{PARTIAL}*"):
        if is_remains(path):
            path.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    if os.name != "posix":
        # There signal 0 would end the process.
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return process != os.getpid()


def _sync_folder(folder: Path) -> None:
    # A rename survives a power cut once its folder has been written. Windows has no such call.
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
