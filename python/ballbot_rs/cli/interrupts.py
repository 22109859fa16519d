"""Ctrl-C and SIGTERM: the command ends soon, whatever it is doing, and leaves no unfinished file behind."""

import contextlib
import os
import signal
import socket
import threading
from collections.abc import Iterator
from typing import Any, Final

from ballbot_rs import _files

#: Time that Python has to unwind, s. Code of a library that does not return to Python is then ended with the process.
GRACE: Final = 0.12

#: What is printed for each signal.
WORDS: Final = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


class Terminated(KeyboardInterrupt):
    """SIGTERM, as an exception that unwinds as Ctrl-C does."""


class Interrupts:
    """What a command has been told by signals.

    Attributes:
        received: the last signal, or None.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._patient = 0
        self._ended = threading.Event()

    @contextlib.contextmanager
    def patient(self) -> Iterator[None]:
        """A context that may take its time to unwind, to save what has been done."""
        self._patient += 1
        try:
            yield
        finally:
            self._patient -= 1

    def watch(self, wakeups: socket.socket) -> None:
        """Ends the process where Python does not; runs in a thread of its own until the socket is closed."""
        while True:
            number = wakeups.recv(1)
            if not number:
                return
            if number[0] not in (signal.SIGINT, signal.SIGTERM):
                continue
            self.received = signal.Signals(number[0])
            if self._patient or self._ended.wait(GRACE):
                continue
            _files.delete_unfinished()
            os.write(2, f"{WORDS[self.received]}\n".encode())
            os._exit(exit_code(self.received))

    def end(self) -> None:
        """Nothing is left to unwind."""
        self._ended.set()


def exit_code(number: signal.Signals) -> int:
    """The exit code of a process that a signal has ended, as a shell counts it."""
    return 128 + number


#: Of the command that is running.
current = Interrupts()


@contextlib.contextmanager
def guarded() -> Iterator[Interrupts]:
    """A context in which signals raise `KeyboardInterrupt` or `Terminated`, and end the process where that fails."""
    global current
    interrupts = current = Interrupts()
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        yield interrupts
        return
    ours, wakeups = socket.socketpair()
    ours.setblocking(False)
    before = signal.set_wakeup_fd(ours.fileno(), warn_on_full_buffer=False)
    is_default = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if is_default:
        signal.signal(signal.SIGTERM, _raise_terminated)
    thread = threading.Thread(target=interrupts.watch, args=(wakeups,), name="interrupts", daemon=True)
    thread.start()
    try:
        yield interrupts
    finally:
        interrupts.end()
        if is_default:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.set_wakeup_fd(before)
        ours.close()
        thread.join()
        wakeups.close()


def _raise_terminated(*_: Any) -> None:
    raise Terminated
