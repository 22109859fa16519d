"""Standard streams of the command: closed, out of space, or with a small character set."""

import codecs
import contextlib
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

#: Exit code of a process whose reader has closed, as a shell counts it: 128 plus the number of SIGPIPE.
BROKEN_PIPE: Final = 141

#: Replacements of characters in our texts that the terminal's encoding lacks.
PLAIN: Final = {"·": "*", "…": "~", "°": " deg", "×": "x", "±": "+-", "µ": "u"}

_ERRORS: Final = "ballbot_rs.plain"


def _plainly(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(c, c.encode("ascii", "backslashreplace").decode()) for c in text), error.end


codecs.register_error(_ERRORS, _plainly)


@contextlib.contextmanager
def prepared() -> Iterator[None]:
    """A context in which all three streams can be used, whatever their state, and every character can be printed."""
    _fill_closed()
    if isinstance(sys.stdout, io.TextIOWrapper) and not sys.stdout.isatty():
        # So that PYTHONUNBUFFERED changes nothing: `flush` finds text that cannot be written.
        sys.stdout.reconfigure(write_through=False)
    changed: list[tuple[io.TextIOWrapper, str]] = []
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not _knows(stream.encoding, "".join(PLAIN)):
            changed.append((stream, stream.errors or "strict"))
            stream.reconfigure(errors=_ERRORS)
    try:
        yield
    finally:
        for stream, errors in changed:
            with contextlib.suppress(OSError):
                stream.reconfigure(errors=errors)


def complain(origin: str, message: str) -> None:
    """Prints an error on one line of standard error; on a terminal its origin is bold and red."""
    is_shown = sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    start, end = ("\x1b[1;31m", "\x1b[0m") if is_shown else ("", "")
    print(f"{start}{origin}:{end} {message}", file=sys.stderr)


def flush() -> None:
    """Writes out what has been printed. After an error nothing more is written.

    Raises:
        BrokenPipeError: the reader has closed.
        OSError: no space left for standard output.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        _give_up()
        if isinstance(error, BrokenPipeError):
            raise
        raise OSError(error.errno, error.strerror, "standard output") from error


def _give_up() -> None:
    # Python would try to write the rest as it exits, and complain.
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError):
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


def _knows(encoding: str, characters: str) -> bool:
    try:
        characters.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _fill_closed() -> None:
    # A file opened later would take the descriptor of a closed stream, and prints would be written to it.
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        mode = "r" if name == "stdin" else "w"
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
