"""Calls of foreign code (policies, laws in Python, models to load), which may take long or never return.

They run in a separate thread. The caller waits for a limited time, or until `cancel` is called or a signal comes. A
thread whose call does not return is abandoned.
"""

import queue
import threading
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")

#: How long an interrupted call may take to end, s.
GRACE = 0.05


class Interrupted(Exception):
    """The wait for a call was ended by `Watch.cancel`."""


class _Job:
    def __init__(self, function: Callable[[], Any]) -> None:
        self.function = function
        #: Whether the caller may stop waiting, and whether the call has ended.
        self.wake, self.done = threading.Event(), threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            self.result = self.function()
        except BaseException as error:
            self.error = error
        self.done.set()
        self.wake.set()


class Watch:
    """One thread for calls, one at a time; a new thread after a call that did not return."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[_Job | None] | None = None
        self._current: _Job | None = None
        self._canceled = False

    def call(
        self, what: str, function: Callable[[], T], seconds: float, interrupt: Callable[[], None] | None = None
    ) -> T:
        """The result of a function, or its exception.

        Args:
            what: name of the call in the error.
            function: called in the other thread.
            seconds: how long it may take.
            interrupt: called from this thread to end a function that takes longer.

        Raises:
            TimeoutError: the function has not returned in time.
            Interrupted: `cancel` was called.
        """
        job = _Job(function)
        self._current = job
        if self._canceled:
            raise Interrupted(f"{what} was interrupted")
        self._thread().put(job)
        try:
            job.wake.wait(seconds)
        finally:
            self._current = None
            if not job.done.is_set():
                self._leave(job, interrupt)
        if job.done.is_set() and not self._canceled and self._jobs is not None:
            if job.error is not None:
                raise job.error
            result: T = job.result
            return result
        if self._canceled:
            raise Interrupted(f"{what} was interrupted")
        raise TimeoutError(f"{what} took longer than {seconds:g} s")

    def _leave(self, job: _Job, interrupt: Callable[[], None] | None) -> None:
        """Abandons a call, whose thread ends when, and if, the call does."""
        assert self._jobs is not None
        self._jobs.put(None)
        self._jobs = None
        _left.add(job)
        if interrupt is not None:
            interrupt()
            job.done.wait(GRACE)

    def cancel(self) -> None:
        """Ends the wait for the current call and rejects all others. From any thread."""
        self._canceled = True
        job = self._current
        if job is not None:
            job.wake.set()

    def __del__(self) -> None:
        if self._jobs is not None:
            self._jobs.put(None)

    def _thread(self) -> "queue.SimpleQueue[_Job | None]":
        if self._jobs is None:
            jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
            threading.Thread(target=_work, args=(jobs,), name="ballbot-watched", daemon=True).start()
            self._jobs = jobs
        return self._jobs


#: Abandoned calls; running calls keep their thread alive.
_left: "weakref.WeakSet[_Job]" = weakref.WeakSet()


def is_any_left() -> bool:
    """Whether an abandoned call still runs."""
    return any(not job.done.is_set() for job in list(_left))


def _work(jobs: "queue.SimpleQueue[_Job | None]") -> None:
    while (job := jobs.get()) is not None:
        job.run()
        # Do not keep its result until the next call.
        del job
