"""Ctrl-C and SIGTERM end the command at once, with one line and no unfinished file; a training is saved first.

The process ends without unwinding: libraries in C++ abort when `KeyboardInterrupt` comes through them, and take their
time to end. Only a part of a command that is `patient` unwinds.
"""

import contextlib
import math
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import Final, NoReturn

from ballbot_rs import _files

#: What is printed for each signal.
WORDS: Final = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

#: What a terminal is sent first: to clear the line of a progress bar, and to show the cursor.
_TERMINAL_RESET: Final = "\r\x1b[2K\x1b[?25h"

#: Time that Python has to call its handler, s.
GRACE: Final = 0.05

_is_installed = False
_is_quiet = False
#: When the handler was called last.
_handled = -math.inf
_patience = 0
_holding = 0
_held: list[int] = []
# A second signal may come while the thread that has it ends the process: it ends it then.
_leaving = threading.RLock()


class Terminated(KeyboardInterrupt):
    """SIGTERM, as an exception that unwinds as Ctrl-C does."""


@contextlib.contextmanager
def patient() -> Iterator[None]:
    """A context in which a signal raises `KeyboardInterrupt` or `Terminated`, so that what has been done is saved."""
    global _patience
    _patience += 1
    try:
        yield
    finally:
        _patience -= 1


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """A context for calls that an exception must not come through; within `patient` it is raised at the end."""
    global _holding
    _holding += 1
    try:
        yield
    finally:
        _holding -= 1
        if _held and not _holding:
            number = _held.pop()
            _held.clear()
            _raise(number)


def exit_code(number: int) -> int:
    """The exit code of a process that a signal has ended, as a shell counts it."""
    return 128 + number


def install() -> None:
    """Handles signals in this process from now on; those that it was started to ignore stay ignored."""
    global _is_installed
    if _is_installed:
        return
    _is_installed = True
    ours, wakeups = socket.socketpair()
    ours.setblocking(False)
    handled = [number for number in WORDS if signal.getsignal(number) is not signal.SIG_IGN]
    for number in handled:
        signal.signal(number, _on_signal)
    signal.set_wakeup_fd(ours.detach(), warn_on_full_buffer=False)
    # Python calls its handlers only between two of its instructions: a thread hears of signals during long calls.
    threading.Thread(target=_watch, args=(wakeups,), name="interrupts", daemon=True).start()


def be_quiet() -> None:
    """A signal ends this process without a word from now on: the one that has started it has the same signal."""
    global _is_quiet
    _is_quiet = True


def _on_signal(number: int, _: FrameType | None) -> None:
    global _handled
    _handled = time.monotonic()
    if not _patience:
        _leave(number)
    if _holding:
        _held.append(number)
    else:
        _raise(number)


def _raise(number: int) -> NoReturn:
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def _watch(wakeups: socket.socket) -> None:
    while True:
        for number in wakeups.recv(64):
            came = time.monotonic()
            time.sleep(GRACE)
            # Python has called its handler, or it is in a call that does not return.
            if number in WORDS and not _patience and _handled < came - GRACE:
                _leave(number)


def _leave(number: int) -> NoReturn:
    # Two threads come here; the first one ends the process, the other one must not print again.
    if not _leaving.acquire(blocking=False):
        while True:
            threading.Event().wait()
    _files.delete_unfinished()
    reset = _TERMINAL_RESET if os.isatty(2) else ""
    if not _is_quiet:
        with contextlib.suppress(OSError):
            os.write(2, f"{reset}{WORDS[signal.Signals(number)]}\n".encode())
    os._exit(exit_code(number))
