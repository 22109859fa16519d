"""The page for scripts, notebooks and bridges: robots that a program shows, commands and observes."""

from __future__ import annotations

import concurrent.futures
import inspect
import time
import webbrowser
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt
from typing_extensions import Unpack

from ballbot_rs._checks import check_options, check_real, check_seed, real_array
from ballbot_rs._core import ROBOTS, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.control.resolve import Source, find
from ballbot_rs.envs.family import are_several
from ballbot_rs.envs.options import TaskOptions
from ballbot_rs.envs.registration import name_of
from ballbot_rs.viewer.server.download import Recorded
from ballbot_rs.viewer.session.opening import open_session
from ballbot_rs.viewer.session.recording import Frame
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.view import View

T = TypeVar("T")

#: Longest time of a command, s: loading a policy and its trial take some.
ANSWER: Final = 30.0

#: Longest real time of `Page.wait`, s, and per simulated second.
WAIT, WAIT_PER_SECOND = 30.0, 10.0

#: Time between two looks at the frame, s.
POLL: Final = 0.01


@named
def show(
    controller: Source = "lqr",
    *,
    task: str | None = None,
    num_robots: int = 1,
    seed: int = 0,
    port: int = 8080,
    open_browser: bool = False,
    **options: Unpack[TaskOptions],
) -> Page:
    """Shows robots in the browser, in real time, as `ballbot view` does, and returns a handle to command them.

    ```python
    with bb.show("lqr", task="velocity") as page:
        print(page.url)
        page.command(0.3, 0.0, yaw_rate=0.5)
        page.wait(2.0)
        print(page.state.ball_velocity)
    ```

    Args:
        controller: as in `simulate`.
        task: name of the task; None is a policy's task, else "balance". "velocity" is driven by `Page.command`.
        num_robots: 1 to 64; they start tilted in different directions, and all follow the same commands.
        seed: of the events and sensors.
        port: where the page is served, on 127.0.0.1; if it is taken, the next free one.
        open_browser: whether to open the page.
        options: as in `simulate`.

    Raises:
        ValueError: an unknown name, a number out of range, or a policy that does not balance this robot.
        TypeError: an option that the task does not have.
        OSError: no port is free.
        ModuleNotFoundError: viser is not installed (extra `view`).
    """
    given = dict(options)
    task = None if task is None else name_of(task)
    found = find(controller, task=task, env_options=given)
    session = open_session(found, given, _robot_of, task=task, num_robots=num_robots, seed=check_seed(seed))
    page = Page(View(session, port))
    if open_browser:
        webbrowser.open(page.url)
    return page


def _robot_of(robot: Any) -> tuple[str, Params | None]:
    if are_several(robot):
        raise InvalidInputError("the page shows one kind of robot: name one (robot=)")
    if isinstance(robot, str) and robot in ROBOTS:
        return robot, None
    return Path(robot).stem if isinstance(robot, (str, PathLike)) else "robot", params_of(robot)


class Page:
    """Robots on a page in the browser, which a program commands and observes; `show` makes one.

    ```python
    with bb.show("lqr", task="velocity", robot="kugle") as page:
        page.command(0.3, 0.0)
        page.wait(0.5)
        print(page.state.ball_velocity)
    ```

    They move in real time in a separate thread. A property returns what the page shows now, up to 1/30 s old; a
    method returns once its command has been carried out, at the next frame. A context manager closes the page.
    Everything may be called from any thread.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self._is_closed = False
        self._wait_until(lambda: view.frame is not None, ANSWER, "the first frame")

    def __enter__(self) -> Page:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Page {self.url}{', closed' if self._is_closed else ''}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="600"></iframe>'

    @property
    def url(self) -> str:
        """The page's address."""
        return self._view.url

    @property
    def gui(self) -> Any:
        """Panel of the page, viser's `GuiApi`, for custom plots, buttons and sliders."""
        return self._view.server.gui

    def add_tab(self, title: str) -> Any:
        """A tab of the panel for custom elements, a context: `with page.add_tab("Power"): page.gui.add_slider(...)`."""
        self._check_running()
        return self._view.add_tab(title)

    @property
    def time(self) -> float:
        """Simulated time since the start or the last reset, s."""
        return self._frame.time

    @property
    def state(self) -> State:
        """State of robot 0."""
        return State.from_array(self._frame.states[0])

    @property
    def states(self) -> npt.NDArray[np.float64]:
        """States of all robots, shape (num_robots, 32), rows as in `State.to_array`."""
        states: npt.NDArray[np.float64] = self._frame.states.copy()
        return states

    @property
    def torques(self) -> npt.NDArray[np.float64]:
        """Wheel torques of all robots, as commanded, shape (num_robots, 3), N·m."""
        torques: npt.NDArray[np.float64] = self._frame.torques.copy()
        return torques

    @property
    def params(self) -> Params:
        """Parameters of robot 0, after events and changes."""
        return self._frame.params

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of the task for the episode of robot 0 so far; empty for balance."""
        commands = self._frame.commands
        return {} if commands is None else dict(commands.metrics)

    def command(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> None:
        """Drives all robots of a task with a velocity command, as "velocity", until the next command.

        The command changes by at most 0.6 m/s² and 2 rad/s² towards these values.

        Args:
            vx: forward velocity of the ball, heading frame, m/s; with `vy` within the option `speed` of the task.
            vy: velocity to the left, m/s.
            yaw_rate: rate of the heading, rad/s, within the option `yaw_rate`.

        Raises:
            ValueError: a number out of range, or a task that is not driven.
        """
        self._in_session(lambda session: session.command(vx, vy, yaw_rate))

    def go_to(self, x: float, y: float) -> None:
        """Moves the setpoint of the task balance, or the goal of the task goal, m; as a click on the floor.

        Raises:
            ValueError: a number out of range, or a task or controller that does not take a position.
        """
        self._in_session(lambda session: session.move_setpoint(x, y))

    def push(self, impulse: npt.ArrayLike) -> None:
        """Pushes the body of every robot at its center of mass: impulse (x, y), inertial frame, N·s, at most 1000.

        Raises:
            ValueError: another shape, or an impulse out of range.
        """
        given = real_array("impulse is", impulse, "two numbers")
        if given.shape != (2,):
            raise InvalidInputError(f"impulse has shape {given.shape}, expected (2,): x and y in N·s")
        x, y = map(float, given)
        self._in_session(lambda session: session.push(float(np.arctan2(y, x)), float(np.hypot(x, y))))

    def set_params(self, params: Robot) -> None:
        """Replaces the parameters of all robots while they move; the controller stays designed for the old ones.

        `page.set_params(page.params.replace(body_mass=3.0))` adds a load.

        Raises:
            ValueError: invalid parameters.
            TypeError: not a robot.
        """
        if params is None:
            raise TypeError("params must name a robot, not None")
        chosen = params_of(params)
        self._in_session(lambda session: session.set_params(chosen))

    def choose(self, **choices: Any) -> None:
        """Chooses another `controller`, `robot` (a preset), `model`, `task`, `num_robots` or `observation`, by name.

        The robots continue, unless their kind, number or ground changes.

        Raises:
            ValueError: an unknown name, or a combination that does not work; then nothing has changed.
            TypeError: another choice.
        """
        check_options("choose()", choices, list(inspect.signature(Session.choose).parameters)[1:])
        if isinstance(controller := choices.get("controller"), str):
            choices["controller"] = find(controller)
        self._in_session(lambda session: session.choose(**choices))

    def reset(self, tilt: npt.ArrayLike | None = None) -> None:
        """Restarts all robots at rest, with a tilt (x, y), rad; None is the last. It ends a recording.

        Raises:
            ValueError: a tilt of more than 30°, or another shape.
            TypeError: a tilt that is not numbers.
        """
        if tilt is not None:
            tilt = real_array("tilt is", tilt, "two components")
        self._in_session(lambda session: session.reset(tilt))

    def record(self) -> None:
        """Begins a recording of up to ten minutes of one robot, in place of the last."""
        self._in_session(lambda session: session.start_recording())

    def recorded(self) -> Trajectory:
        """Ends the recording; robot 0 in it, at 100 Hz at most, which can plot, export and record itself as a video.

        Raises:
            ValueError: nothing has been recorded.
        """

        def take(session: Session) -> Recorded:
            session.stop_recording()
            return Recorded.of(session)

        recorded = self._in_session(take)
        if len(recorded.frames) < 2:
            raise InvalidInputError("nothing has been recorded: call record before")
        return recorded.trajectory()

    def wait(self, seconds: float) -> None:
        """Waits until the robots have moved for this simulated time, s.

        Raises:
            ValueError: a negative number.
            TimeoutError: it takes over ten times this time plus 30 s, for example because the page is paused.
            RuntimeError: the page is closed.
        """
        if not check_real("seconds", seconds) >= 0.0:
            raise InvalidInputError(f"seconds = {seconds} is out of range: it must be at least 0")
        last, moved = self.time, 0.0

        def has_moved() -> bool:
            nonlocal last, moved
            # A reset begins at 0.
            now = self.time
            moved, last = moved + max(now - last, 0.0), now
            return moved >= seconds

        self._wait_until(has_moved, WAIT + WAIT_PER_SECOND * seconds, f"{seconds:g} s of simulated time")

    @property
    def is_running(self) -> bool:
        """Whether the robots can move: the page is not closed and has not failed."""
        return not self._is_closed and self._view.runner.running

    def close(self) -> None:
        """Ends the simulation and the server."""
        if not self._is_closed:
            self._is_closed = True
            self._view.stop()

    @property
    def _frame(self) -> Frame:
        frame = self._view.frame
        assert frame is not None
        return frame

    def _in_session(self, function: Callable[[Session], T]) -> T:
        """The result of a function in the thread that owns the session."""
        self._check_running()
        answer: concurrent.futures.Future[T] = concurrent.futures.Future()

        def command(session: Session) -> None:
            try:
                answer.set_result(function(session))
            except Exception as error:
                answer.set_exception(error)

        self._wait_until(lambda: self._view.runner.submit(command), ANSWER, "room for a command")
        self._wait_until(answer.done, ANSWER, "a command")
        return answer.result()

    def _wait_until(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        ends = time.monotonic() + seconds
        while not condition():
            self._check_running()
            if time.monotonic() > ends:
                raise TimeoutError(f"waited {seconds:g} s for {what}")
            time.sleep(POLL)

    def _check_running(self) -> None:
        if not self.is_running:
            cause = self._view.runner.error
            raise RuntimeError("the page is closed" if cause is None else "the simulation has stopped") from cause
