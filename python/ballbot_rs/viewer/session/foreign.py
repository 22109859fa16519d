"""Foreign controllers (policies, laws in Python): time limits of their calls, trials on other robots."""

import math
import queue
import threading
import weakref
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from ballbot_rs._core import Params
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.registration import DEFAULT_TASK, geometry_of
from ballbot_rs.viewer.session.objective import Objective
from ballbot_rs.viewer.session.robots import Robots
from ballbot_rs.viewer.session.setup import Setup

T = TypeVar("T")

#: How long an interrupted call may take to end, s.
GRACE = 0.05

#: Abandoned calls and calls next to the simulation; running calls keep their thread alive.
_left: "weakref.WeakSet[Job]" = weakref.WeakSet()

#: Length of a trial, s, and its initial tilts, rad: the page's initial tilt, and perpendicular to it.
TRIAL_SECONDS = 3.0
TRIAL_TILTS = ((math.radians(3.0), 0.0), (0.0, math.radians(3.0)))

#: Options of a task that pushes robots: any robot may fall after a push.
WITHOUT_PUSHES: Mapping[str, Any] = {"push": (0.0, 0.0)}


class Interrupted(Exception):
    """The wait for a call was ended by `Watchdog.cancel`."""


class Job:
    """A call in another thread."""

    def __init__(self, function: Callable[[], Any]) -> None:
        self.function = function
        #: Whether the caller may stop waiting, and whether the call has ended.
        self.wake, self.done = threading.Event(), threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        """Calls the function, in the present thread."""
        try:
            self.result = self.function()
        except BaseException as error:
            self.error = error
        self.done.set()
        self.wake.set()


class Watchdog:
    """One thread for calls, one at a time; a new thread after a call that did not return."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Job | None] | None = None
        self._current: Job | None = None
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
        job = Job(function)
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

    def _leave(self, job: Job, interrupt: Callable[[], None] | None) -> None:
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

    def _thread(self) -> "queue.SimpleQueue[Job | None]":
        if self._jobs is None:
            jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
            threading.Thread(target=_work, args=(jobs,), name="ballbot-watched", daemon=True).start()
            self._jobs = jobs
        return self._jobs


def is_any_left() -> bool:
    """Whether an abandoned call, or a call next to the simulation, still runs."""
    return any(not job.done.is_set() for job in list(_left))


def begin(function: Callable[[], Any]) -> Job:
    """Calls a function in a separate thread, next to the simulation."""
    job = Job(function)
    _left.add(job)
    threading.Thread(target=job.run, name="ballbot-background", daemon=True).start()
    return job


def _work(jobs: "queue.SimpleQueue[Job | None]") -> None:
    while (job := jobs.get()) is not None:
        job.run()
        # Do not keep its result until the next call.
        del job


def check_balances(controller: ResolvedController, objective: Objective, setup: Setup) -> None:
    """Rejects a policy on a robot on which it falls, unless it was trained on that robot.

    Args:
        controller: the policy; a law is not tried.
        objective: the policy's objective on one robot, not used otherwise.
        setup: the robot; it is tried without events and changes, on the model `contact`.

    Raises:
        ValueError: it falls.
    """
    if controller.policy is None or trained_on(controller.env_options) == setup.nominal:
        return
    driver = objective.driver
    tried = Setup(
        setup.name,
        setup.nominal,
        "contact",
        setup.sim_dt,
        setup.max_torque,
        substeps=1 if setup.task == DEFAULT_TASK else setup.substeps,
        task=setup.task,
        task_options={**setup.task_options, **(WITHOUT_PUSHES if geometry_of(setup.task) == "impulse" else {})},
        terrain=setup.terrain,
    )
    for tilt in TRIAL_TILTS:
        robots = Robots(tried, 1)
        robots.reset(tilt)
        objective.reset()
        for step in range(round(TRIAL_SECONDS / driver.control_dt)):
            torques = objective.torques(robots, lambda function: function())
            robots.step(torques, round(driver.control_dt / driver.sim_dt))
            if robots.fallen[0]:
                raise ValueError(
                    f"{controller.name} was trained on another robot and does not balance {setup.name}: in a trial it "
                    f"fell after {(step + 1) * driver.control_dt:.1f} s; choose another controller or robot"
                )


def trained_on(env_options: Mapping[str, Any]) -> Params | None:
    """The robot of the environment that a policy was trained in; None if its file no longer exists."""
    params = env_options.get("robot")
    try:
        return new_batch(1, num_threads=1, options={} if params is None else {"robot": params}).params(0)
    except OSError:
        return None
