"""Calls of what others wrote (policies, laws in Python, models to be loaded), which may take long or never return.

They run in a thread of their own. The caller waits for a limited time, and less if `cancel` is called. A thread whose
call does not return is left behind: it does not keep Python from ending.
"""

import queue
import threading
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Interrupted(Exception):
    """The wait for a call was ended by `Watch.cancel`."""


class _Job:
    def __init__(self, function: Callable[[], Any]) -> None:
        self.function = function
        self.ended = threading.Event()
        self.returned = False
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            self.result = self.function()
            self.returned = True
        except BaseException as error:
            self.error = error
        self.ended.set()


class Watch:
    """One thread for calls, one at a time; a new one after a call that did not return."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[_Job | None] | None = None
        self._current: _Job | None = None
        self._cancelled = False

    def call(
        self, what: str, function: Callable[[], T], seconds: float, interrupt: Callable[[], None] | None = None
    ) -> T:
        """What a function returns, or its exception.

        Args:
            what: name of the call in the error.
            function: called in the other thread.
            seconds: how long it may take.
            interrupt: called to end a function that takes longer, from this thread.

        Raises:
            TimeoutError: the function has not returned in time.
            Interrupted: `cancel` was called.
        """
        job = _Job(function)
        self._current = job
        if self._cancelled:
            raise Interrupted(f"{what} was interrupted")
        self._thread().put(job)
        job.ended.wait(seconds)
        self._current = None
        if job.error is not None:
            raise job.error
        if job.returned:
            result: T = job.result
            return result
        # The thread ends when, and if, the call does.
        assert self._jobs is not None
        self._jobs.put(None)
        self._jobs = None
        if interrupt is not None:
            interrupt()
        if self._cancelled:
            raise Interrupted(f"{what} was interrupted")
        raise TimeoutError(f"{what} took longer than {seconds:g} s")

    def cancel(self) -> None:
        """Ends the wait for the current call and refuses all others. From any thread."""
        self._cancelled = True
        job = self._current
        if job is not None:
            job.ended.set()

    def __del__(self) -> None:
        if self._jobs is not None:
            self._jobs.put(None)

    def _thread(self) -> "queue.SimpleQueue[_Job | None]":
        if self._jobs is None:
            jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
            threading.Thread(target=_work, args=(jobs,), name="ballbot-watched", daemon=True).start()
            self._jobs = jobs
        return self._jobs


def _work(jobs: "queue.SimpleQueue[_Job | None]") -> None:
    while (job := jobs.get()) is not None:
        job.run()
