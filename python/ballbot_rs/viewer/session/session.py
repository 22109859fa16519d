"""A session: robots, their controllers, and user actions. It does not depend on the browser."""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of
from ballbot_rs.viewer.session.balancing import Balancing
from ballbot_rs.viewer.session.commanding import Commanding
from ballbot_rs.viewer.session.configured import MAX_LOAD, MAX_ROBOTS, Configured
from ballbot_rs.viewer.session.ghost import ghost_of, keep_up, label_of, shared
from ballbot_rs.viewer.session.recording import Frame

__all__ = ["MAX_ROBOTS", "Session"]

T = TypeVar("T")

#: Longest time of a policy, or of a law outside the core, for a control step, s.
MAX_CALL = 1.0

#: How long a fallen robot lies before it restarts, s.
LIES_FOR = 2.0

#: How long a push is shown, s.
PUSH_SECONDS = 0.7

#: Distance by which a click is moved without a message, m.
CLICK_TOLERANCE = 1e-6

#: Bounds of the page's inputs: simulated time per real time, rad and N·s.
MIN_SPEED, MAX_SPEED = 0.01, 8.0
MAX_TILT = math.radians(30.0)
MAX_IMPULSE = 1000.0


class Session(Configured):
    """Everything that a page shows and commands. Not thread-safe: `Runner` owns a session."""

    @shared
    def reset(self, tilt: npt.ArrayLike | None = None) -> None:
        """Restarts all robots, at rest, with the setpoint at the origin or commands that the task samples.

        The tilt (two components, rad) is kept for the next time.
        """
        start = self.start_tilt if tilt is None else np.asarray(tilt, dtype=np.float64)
        if start.shape != (2,):
            raise ValueError(f"tilt = {tilt!r}: expected two components")
        check_bounded("tilt", float(np.hypot(*start)), 0.0, MAX_TILT)
        self.robots.reset(start)
        self.start_tilt = start
        self._objective.reset()
        self.time = 0.0
        self._ahead = 0.0
        self.history.clear()
        self.replay_time = None
        self.pull_point = None
        self.pushed = None
        self.stop_recording()

    @shared
    def push(self, direction: float, impulse: float) -> None:
        """Pushes every robot horizontally: direction in rad from inertial x, impulse in N·s."""
        direction = check_bounded("direction", direction, -1e3, 1e3)
        impulse = check_bounded("impulse", impulse, 0.0, MAX_IMPULSE)
        x, y = impulse * math.cos(direction), impulse * math.sin(direction)
        for robot in self.robots:
            robot.push([x, y, 0.0])
        self.pushed = (self.time, np.array([x, y]))

    @shared
    def pull(self, towards: npt.ArrayLike | None) -> None:
        """Pulls robot 0 towards a point (inertial frame, m) from now on; None releases it."""
        if towards is not None:
            point = np.asarray(towards, dtype=np.float64)
            if point.shape != (3,) or not np.isfinite(point).all():
                raise ValueError(f"pull towards {towards}: expected three finite numbers")
            towards = point
        self.pull_point = towards

    @shared
    def move_setpoint(self, x: float, y: float) -> None:
        """Sets the target position, m: setpoint, or goal of the task goal; in a batch, relative to each robot's start.

        Raises:
            ValueError: a number out of range, or a controller or task that does not take a position.
        """
        self._objective.click(self.robots, x, y)

    def click(self, x: float, y: float) -> None:
        """A click on the floor, m: as `move_setpoint`, or to the nearest allowed point, which a message names.

        Raises:
            ValueError: as `move_setpoint`, for reasons other than a distant point.
        """
        near = self._objective.nearest(self.robots, x, y)
        self.move_setpoint(*near)
        if math.dist(near, (x, y)) > CLICK_TOLERANCE:
            self.notices.append(
                f"({x:.3g}, {y:.3g}) m is too far: set to ({near[0]:.3g}, {near[1]:.3g}) m, {self._objective.reach}"
            )

    @shared
    def follow(self, route: str) -> None:
        """Moves the setpoint along a closed curve from its present position, one of `balancing.ROUTES`.

        Raises:
            ValueError: an unknown curve, a task other than balance, or a controller that does not follow a position.
        """
        objective = self._objective
        if not isinstance(objective, Balancing):
            raise ValueError(f"the task {self.task} generates its commands: choose the task {DEFAULT_TASK}")
        self._watched(self._controller, lambda: objective.follow(route), MAX_LOAD)

    @shared
    def drive(self, forward: float, left: float, turn: float) -> None:
        """Commands the task velocity: fractions in [-1, 1] of its largest speed, heading frame, and of its yaw rate.

        Raises:
            ValueError: a number out of range, or another task.
        """
        self._driven().drive(forward, left, turn)

    @shared
    def command(self, vx: float, vy: float, yaw_rate: float) -> None:
        """Commands the task velocity: m/s, heading frame, and rad/s, within the speeds of the task.

        Raises:
            ValueError: a number out of range, or another task.
        """
        self._driven().command(vx, vy, yaw_rate)

    def _driven(self) -> Commanding:
        if self.commanding is None:
            raise ValueError(f"the task {self.task} is not driven: choose the task velocity")
        return self.commanding

    @shared
    def sample_commands(self) -> None:
        """Returns the commands to the task: its next episodes begin at the robots' present positions.

        Raises:
            ValueError: the task has no commands.
        """
        if not description_of(self.task)["command"]:
            raise ValueError(f"the task {self.task} has no commands")
        for robot in self.robots:
            robot.begin_episode()
        self._objective.reset()

    def set_speed(self, speed: float) -> None:
        """Simulated time per real time: 1 is real time."""
        self.speed = check_bounded("speed", speed, MIN_SPEED, MAX_SPEED)

    def step(self) -> None:
        """One control step, or one frame of a replay."""
        if self.replay_time is not None:
            self._move_replay(self.driver.control_dt)
            return
        driver, robots = self.driver, self.robots
        torques = self._objective.torques(robots, self._of_driver)
        if self.pull_point is not None:
            robots.pull(self.pull_point, driver.control_dt)
        lost = robots.step(torques, self._substeps)
        for index, reason in lost.items():
            self.notices.append(f"robot {index} {reason} and starts again")
        self._restart_fallen()
        for index in lost:
            self._objective.restarted(self.robots, index)
        self.time += driver.control_dt
        keep_up(self)
        if not self._note(self._frame()):
            self.notices.append(f"the recording is full, after {self.recording.duration:.0f} s")

    def _of_driver(self, function: Callable[[], T]) -> T:
        return self._watched(self._controller, function, MAX_CALL) if self.driver.is_foreign else function()

    def _restart_fallen(self) -> None:
        """Restarts robots that have lain for a while; without a controller they stay where they are."""
        if self.controller != "zero":
            fallen = np.flatnonzero(self.robots.down_for >= LIES_FOR).tolist()
            for index in fallen:
                self.notices.append(f"robot {index} fell and starts again")
            self.restart(fallen)

    def restart(self, indices: Iterable[int]) -> None:
        """Restarts individual robots, as at the last reset."""
        for index in indices:
            self.robots.restart(index)
            self._objective.restarted(self.robots, index)

    def advance(self, seconds: float) -> float:
        """Advances by real time: whole control steps, the rest is kept. Returns the simulated time, s."""
        if self.paused:
            return 0.0
        if self.replay_time is not None:
            self._move_replay(seconds * self.speed)
            return 0.0
        self._ahead += seconds * self.speed
        steps = int(self._ahead / self.driver.control_dt + 1e-9)
        for _ in range(steps):
            self.step()
        self._ahead -= steps * self.driver.control_dt
        return steps * self.driver.control_dt

    def frame(self) -> Frame:
        """The frame to show now. At its end, a replay keeps showing its last frame."""
        if self.replay_time is not None:
            return self.recording.at(self.replay_time)
        return self._frame()

    def compare_with(self, controller: str | None) -> None:
        """Adds a second robot under another controller, in the state of robot 0; None removes it.

        Raises as the constructor, and changes nothing then.
        """
        if controller is None:
            self.ghost = None
            return
        robots = self.robots
        ghost = Session(
            robots.model,
            robots.name,
            controller,
            1,
            self._own.get(robots.name),
            self._motors,
            self._events,
            self._seed,
            self._sensors,
            self.observation,
            self.task,
            {**self._options_of(self.task), "terrain": robots.setup.terrain},
        )
        ghost._become(
            dataclasses.replace(ghost.robots.setup, changes=robots.setup.changes, replaced=robots.setup.replaced)
        )
        ghost.robots.continue_from(robots)
        ghost._objective.continue_from(ghost.robots, self._objective)
        ghost.start_tilt, ghost.time = self.start_tilt, self.time
        self.ghost = ghost

    def _compare_again(self) -> None:
        """As `Configured`."""
        if self.ghost is None:
            return
        name, self.ghost = self.ghost.controller, None
        try:
            self.compare_with(name)
        except (TypeError, ValueError, OSError, TimeoutError) as error:
            self.notices.append(f"the comparison with {name} ended: {error}")

    def _frame(self) -> Frame:
        ghost = None if self.ghost is None else ghost_of(self.ghost)
        shown = self._objective.shown(self.robots)
        if self.pushed is not None and self.time - self.pushed[0] < PUSH_SECONDS:
            shown |= {"push_time": self.pushed[0], "push": self.pushed[1]}
        limits = {name: self._controller.law_options.get(name) for name in ("speed_limit", "boundary")}
        return self.robots.frame(self.time, label=label_of(self.controller), ghost=ghost, **limits, **shown)
