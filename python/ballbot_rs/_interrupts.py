"""Ctrl-C, SIGTERM and SIGHUP end the command at once, with one line and no unfinished file; training is saved first.

The process ends without unwinding: C++ libraries abort when `KeyboardInterrupt` passes through them, and end slowly.
Only a part of a command that is `patient` unwinds.
"""

import contextlib
import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Final, NoReturn

from ballbot_rs import _files

#: Message for each signal; Windows has no SIGHUP.
WORDS: Final = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
if sys.platform != "win32":
    WORDS[signal.SIGHUP] = "hung up"

#: Sent to a terminal first: clears the line of a progress bar, and shows the cursor.
_TERMINAL_RESET: Final = "\r\x1b[2K\x1b[?25h"

#: Time that Python has to call its handler, s.
GRACE: Final = 0.05

#: Called before the process ends without unwinding, to end what would outlive it.
endings: Final[set[Callable[[], object]]] = set()

_is_installed = False
_is_quiet = False
#: Time of the last call of the handler.
_handled = -math.inf
_patience = 0
_holding = 0
_held: list[int] = []
_staying = 0
_deferred: list[int] = []
# Reentrant: a second signal may interrupt the thread that ends the process, and then ends it.
_leaving = threading.RLock()


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP, as an exception that unwinds as Ctrl-C does."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = signal.Signals(number)


@contextlib.contextmanager
def patient() -> Iterator[None]:
    """A context in which a signal raises `KeyboardInterrupt` or `Terminated`, so that the work so far is saved."""
    global _patience
    _patience += 1
    try:
        yield
    finally:
        _patience -= 1


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """A context for calls that an exception must not pass through; within `patient` it is raised at the end."""
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


@contextlib.contextmanager
def unbroken() -> Iterator[None]:
    """A context at whose end signals take effect, such as the start of a child process that is in `endings` then."""
    global _staying
    _staying += 1
    try:
        with held_back():
            yield
    finally:
        _staying -= 1
        if _deferred and not _staying:
            _leave(_deferred.pop())


def exit_code(number: int) -> int:
    """The exit code of a process that a signal ended, as a shell counts it."""
    return 128 + number


def install() -> None:
    """Handles signals in this process from now on; signals that it was started to ignore stay ignored."""
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
    # Python calls its handlers only between two of its instructions: a thread receives signals during long calls.
    threading.Thread(target=_watch, args=(wakeups,), name="interrupts", daemon=True).start()


def be_quiet() -> None:
    """From now on a signal ends this process without a message: its parent process gets the same signal."""
    global _is_quiet
    _is_quiet = True


def _on_signal(number: int, _: FrameType | None) -> None:
    global _handled
    _handled = time.monotonic()
    if not _patience:
        _leave(number)
    elif _holding:
        _held.append(number)
    else:
        _raise(number)


def _raise(number: int) -> NoReturn:
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)


def _watch(wakeups: socket.socket) -> None:
    while True:
        for number in wakeups.recv(64):
            came = time.monotonic()
            time.sleep(GRACE)
            # Python has called its handler, or is in a call that does not return.
            if number in WORDS and not _patience and _handled < came - GRACE:
                _leave(number)


def _leave(number: int) -> None:
    if _staying:
        _deferred.append(number)
        return
    # Two threads come here; the first ends the process, the second must not print again.
    if not _leaving.acquire(blocking=False):
        while True:
            threading.Event().wait()
    _files.delete_unfinished()
    for end in list(endings):
        end()
    reset = _TERMINAL_RESET if os.isatty(2) else ""
    if not _is_quiet:
        with contextlib.suppress(OSError):
            os.write(2, f"{reset}{WORDS[signal.Signals(number)]}\n".encode())
    os._exit(exit_code(number))
