"""Sensitivities of the present robot under its controller, computed next to the simulation."""

import math
import time
from pathlib import Path
from typing import Final

from ballbot_rs._machine import threads
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.sensitivity import Sensitivity, collect
from ballbot_rs.viewer.session.foreign import Job, begin
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.session.setup import NEUTRAL

#: Simulated time, and duration of the push as in the task push, s: the impact of a sudden push hides all other loads.
SECONDS: Final = 4.0
PUSH_DURATION: Final = 0.1

#: Time limit of a computation, s.
MAX_SECONDS: Final = 300.0


class Sensitivities:
    """The last sensitivities, and the computation of the next; used in the thread of the session."""

    def __init__(self) -> None:
        self.found: Sensitivity | None = None
        #: Robot, controller, task and push of `found`.
        self.conditions = ""
        #: Why there are none.
        self.error = ""
        self._computing: _Computation | None = None

    @property
    def progress(self) -> float | None:
        """Fraction that is done; None if nothing is computed."""
        return None if self._computing is None else self._computing.fraction

    def start(self, session: Session, direction: float, impulse: float) -> None:
        """Begins a computation: robot and controller of a session, a push with direction, rad, and impulse, N·s.

        The robot starts upright at the origin; commands are the first that the task samples with seed 0.
        """
        self.stop()
        self.found, self.error = None, ""
        try:
            self._computing = _Computation(session, direction, impulse)
        except TypeError as error:
            self.error = str(error)

    def stop(self) -> None:
        """Ends a computation."""
        if self._computing is not None:
            self._computing.is_stopped = True
            self._computing = None

    def update(self) -> None:
        """Takes the result when it has come."""
        computing = self._computing
        if computing is None:
            return
        job = computing.job
        if job.done.is_set():
            self._computing = None
            self.found, self.conditions = job.result, computing.conditions
            self.error = "" if job.error is None else str(job.error) or type(job.error).__name__
        elif time.monotonic() > computing.ends:
            self.stop()
            self.error = f"{computing.conditions}: it took longer than {MAX_SECONDS:g} s"


class _Computation:
    def __init__(self, session: Session, direction: float, impulse: float) -> None:
        setup, controller = session.robots.setup, session.resolved.copied()
        options = {**setup.options, "robot": setup.nominal, "control_dt": session.driver.control_dt}
        # As the task has it, in place of the floor.
        options.pop("fall_tilt", None)
        push = Push((impulse * math.cos(direction), impulse * math.sin(direction), 0.0), 0.0, PUSH_DURATION)
        robot = setup.name if setup.changes == NEUTRAL else f"{setup.name} as changed"
        name = Path(session.controller).name
        self.conditions = (
            f"{name} on {robot}, {setup.model}, task {setup.task}: {SECONDS:g} s with a push of {impulse:g} N·s to "
            f"{math.degrees(direction):.0f} deg over {PUSH_DURATION:g} s"
        )
        self.fraction, self.is_stopped = 0.0, False
        self.ends = time.monotonic() + MAX_SECONDS
        self.job: Job = begin(
            lambda: collect(
                controller,
                robot=setup.params,
                tilt=(0.0, 0.0),
                pushes=push,
                seconds=SECONDS,
                task=setup.task,
                env_options=options,
                # One is for the page.
                num_threads=max((threads() or 1) - 1, 1),
                progress=self._report,
            )
        )

    def _report(self, done: int, total: int) -> None:
        if self.is_stopped:
            raise InterruptedError("stopped")
        self.fraction = done / total
