"""A session: robots, their controllers, and user actions. It does not depend on the browser."""

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import MODELS, ROBOTS, Params, load_sensors
from ballbot_rs.control.resolve import NAMES, ResolvedController, common_task, find
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of, env_id_of
from ballbot_rs.viewer.session.commands import Balancing, Commanding, Objective, objective_of
from ballbot_rs.viewer.session.drivers import Driver
from ballbot_rs.viewer.session.foreign import Watchdog, check_balances
from ballbot_rs.viewer.session.ghost import keep_up, shared
from ballbot_rs.viewer.session.recording import Frame, Player
from ballbot_rs.viewer.session.robots import Robots
from ballbot_rs.viewer.session.setup import (
    DEFAULT_SENSORS,
    NEUTRAL,
    Events,
    Grounds,
    Motors,
    Sensors,
    Setup,
    check_observation,
    checked,
)

#: Number of messages kept.
KEPT = 20

T = TypeVar("T")

MAX_ROBOTS = 64

#: Time limits of a policy, or of a law outside the core, for a control step, and for loading and trial, s.
MAX_CALL = 1.0
MAX_LOAD = 10.0

#: How long a fallen robot lies before it restarts, s.
LIES_FOR = 2.0

#: How long a push is shown, s.
PUSH_SECONDS = 0.7

#: Bounds of the page's inputs: simulated time per real time, rad and N·s.
MIN_SPEED, MAX_SPEED = 0.01, 8.0
MAX_TILT = math.radians(30.0)
MAX_IMPULSE = 20.0


class Notices(deque[str]):
    """The last messages, and their total number."""

    def __init__(self) -> None:
        super().__init__(maxlen=KEPT)
        self.total = 0

    def append(self, text: str) -> None:
        """Adds a message."""
        super().append(text)
        self.total += 1


class Session(Player):
    """Everything that a page shows and commands. Not thread-safe: `Runner` owns a session.

    Args:
        model: "planar", "spatial", "contact" or "rigid".
        robot: the name of a preset, or of `params`.
        controller: one of `control.resolve.NAMES`, the path of an ONNX policy, or a result of `control.resolve.find`.
        num_robots: number of robots.
        params: a robot that is not a preset.
        motors: the option `actuators` of an environment; None is ideal motors.
        events: the option `events` of an environment: what is sampled at random for the robots. Controllers are made
            for the robot without events.
        seed: of the samples.
        sensors: the option `sensors` of an environment. None is exact sensors with `observation` "sensors", else the
            sensors of kugle, for when they are chosen.
        observation: input of controllers, "ground_truth" (the true states) or "sensors" (estimates).
        task: name of a task; None is a policy's task, else balance.
        task_options: options of that task, overridden by the options of a policy's training; `terrain` is the ground,
            which allows only one robot.

    Raises:
        ValueError: an unknown name, a number out of range, motors, sensors or events that do not fit the robot, or a
            policy that falls on a robot that it was not trained on.
        FileNotFoundError: there is no policy at that path.
        TimeoutError: a policy takes too long.
    """

    def __init__(
        self,
        model: str = "contact",
        robot: str = "paper",
        controller: str | ResolvedController = "lqr",
        num_robots: int = 1,
        params: Params | None = None,
        motors: Motors = None,
        events: Events = None,
        seed: int = 0,
        sensors: Sensors | str = None,
        observation: str = "ground_truth",
        task: str | None = None,
        task_options: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self._own = {} if params is None else {robot: params}
        self._motors, self._events, self._seed = motors, events, seed
        check_observation(observation)
        chosen = DEFAULT_SENSORS[observation] if sensors is None else sensors
        self._sensors = load_sensors(chosen) if isinstance(chosen, str) else chosen
        self.time = 0.0
        self.paused = False
        self.speed = 1.0
        self.start_tilt = np.radians([3.0, 0.0])
        self.notices = Notices()
        #: The same robot under another controller, for comparison.
        self.ghost: Session | None = None
        #: Last manual push: time, s, and impulse (x, y), N·s.
        self.pushed: tuple[float, npt.NDArray[np.float64]] | None = None
        self.pull_point: npt.NDArray[np.float64] | None = None
        self.watchdog = Watchdog()
        self._ahead = 0.0
        self._task_options = dict(task_options or {})
        self._grounds = Grounds()
        self._controller = self._found(controller)
        self._first_task = chosen_task = common_task([self._controller], task)
        self._objective, setup = self._make(
            model, robot, self._controller, num_robots, NEUTRAL, observation, chosen_task, self._task_options
        )
        self.robots = Robots(setup, num_robots)
        if sensors is not None:
            # They may be chosen later.
            dataclasses.replace(setup, sensors=self._sensors, substeps=self._substeps).batch(0)
        self.reset()

    @property
    def controller(self) -> str:
        """Name of the controller, or path of the policy."""
        return self._controller.name

    @property
    def resolved(self) -> ResolvedController:
        """The controller, not on any robot yet."""
        return self._controller

    @property
    def task(self) -> str:
        """Name of the task."""
        return self._objective.task

    @property
    def driver(self) -> Driver:
        """The controller on every robot."""
        return self._objective.driver

    @property
    def commanding(self) -> Commanding | None:
        """The task, unless it is balance."""
        return self._objective if isinstance(self._objective, Commanding) else None

    @property
    def takes_clicks(self) -> bool:
        """Whether a click on the floor is a command."""
        return self._objective.takes_clicks

    @property
    def _substeps(self) -> int:
        return round(self.driver.control_dt / self.driver.sim_dt)

    @property
    def setpoint(self) -> npt.NDArray[np.float64]:
        """The setpoint of the task balance, m; zeros in other tasks."""
        return self._objective.setpoint if isinstance(self._objective, Balancing) else np.zeros(2)

    @property
    def changes(self) -> dict[str, float]:
        """Changes of the robots, by the names of `setup.CHANGES`."""
        return dict(self.robots.setup.changes)

    @property
    def observation(self) -> str:
        """Input of controllers, one of `OBSERVATIONS`."""
        return "ground_truth" if self.robots.setup.sensors is None else "sensors"

    def _make(
        self,
        model: str,
        robot: str,
        controller: ResolvedController,
        num_robots: int,
        changes: Mapping[str, float],
        observation: str,
        task: str,
        task_options: Mapping[str, Any],
    ) -> tuple[Objective, Setup]:
        if model not in MODELS:
            raise ValueError(f"unknown model '{model}': expected one of {', '.join(MODELS)}")
        if isinstance(num_robots, bool) or not isinstance(num_robots, int) or not 1 <= num_robots <= MAX_ROBOTS:
            raise ValueError(f"num_robots = {num_robots} is out of range: expected 1 to {MAX_ROBOTS}")
        params = self.params_of(robot)
        env_id_of(task)
        given = controller.env_options.get("terrain", task_options.get("terrain"))
        terrain = self._grounds.of(task, params, given)
        if terrain is not None and num_robots > 1:
            raise ValueError(f"num_robots = {num_robots}: there is one robot on uneven ground")
        task_options = {**task_options, "terrain": terrain}
        objective = objective_of(controller, params, num_robots, task, task_options)
        driver = objective.driver
        sensors = self._sensors if observation == "sensors" or driver.reads_sensors else None
        steps_alone = task == DEFAULT_TASK and sensors is None
        setup = Setup(
            robot,
            params,
            model,
            driver.sim_dt,
            driver.max_torque,
            self._motors,
            self._events,
            self._seed,
            changes,
            sensors,
            1 if steps_alone else round(driver.control_dt / driver.sim_dt),
            task,
            objective.task_options,
            terrain,
        )
        if controller.policy is not None:
            one = objective_of(controller, params, 1, task, task_options)
            self._watched(controller, lambda: check_balances(controller, one, setup), MAX_LOAD)
        return objective, setup

    def _found(self, controller: str | ResolvedController) -> ResolvedController:
        """A page may name any controller or ONNX file: these have no pickled code."""
        if not isinstance(controller, str) or controller in NAMES:
            return find(controller, trusted=False)
        return self.watchdog.call(f"loading {controller}", lambda: find(controller, trusted=False), MAX_LOAD)

    def _watched(self, controller: ResolvedController, function: Callable[[], T], seconds: float) -> T:
        """The result of a function that calls a controller, with a time limit."""
        return self.watchdog.call(controller.name, function, controller.max_call or seconds, controller.interrupt)

    def params_of(self, robot: str) -> Params:
        """Parameters of a robot by name. Raises ValueError for an unknown name."""
        return self._own[robot] if robot in self._own else Params.preset(robot)

    @property
    def robot_names(self) -> list[str]:
        """Robots to choose from."""
        return [*self._own, *ROBOTS]

    def choose(
        self,
        *,
        model: str | None = None,
        robot: str | None = None,
        controller: str | ResolvedController | None = None,
        num_robots: int | None = None,
        observation: str | None = None,
        task: str | None = None,
    ) -> None:
        """Changes the simulation. The robots continue, unless kind, number or ground changes: then they restart.

        Estimates restart at the true states, unless all of their inputs remain. A policy sets its task.

        Raises as the constructor, and changes nothing then.
        """
        old = self.robots
        if observation is not None:
            check_observation(observation)
        # The file of a policy that is already in use is not read again.
        chosen = self._controller
        if controller is not None and controller != self.controller:
            chosen = self._found(controller)
        count = len(old) if num_robots is None else num_robots
        task = common_task([chosen], task) if task is not None or chosen.task is not None else self.task
        objective, setup = self._make(
            old.model if model is None else model,
            old.name if robot is None else robot,
            chosen,
            count,
            old.setup.changes,
            self.observation if observation is None else observation,
            task,
            self._options_of(task),
        )
        if setup.name == old.name:
            setup = dataclasses.replace(setup, replaced=old.setup.replaced)
        restarts = (setup.name, count, setup.terrain) != (old.name, len(old), old.setup.terrain)
        self.robots = Robots(setup, count) if restarts else old if setup == old.setup else old.become(setup)
        before, self._controller, self._objective = self._objective, chosen, objective
        if restarts:
            self.reset()
        else:
            objective.continue_from(self.robots, before)
        self.replay_time = None
        self._compare_again()

    @shared
    def change(self, /, **values: float) -> None:
        """Changes parameters, motors and sensors of all robots, by the names of `setup.CHANGES`; others remain.

        The robots continue. Controllers and estimator remain designed for the unchanged robot.

        Raises:
            ValueError: an unknown name, a number out of range, or invalid parameters or motors; then nothing has
                changed.
        """
        changes = {**self.changes, **checked(values)}
        if changes != self.changes:
            self._become(dataclasses.replace(self.robots.setup, changes=changes))

    @shared
    def set_params(self, params: Params) -> None:
        """Replaces the parameters of all robots, to which `change` then applies.

        The robots continue. Controllers and estimator remain designed for the robot that was chosen.

        Raises:
            ValueError: invalid parameters; then nothing has changed.
        """
        self._become(dataclasses.replace(self.robots.setup, replaced=params))

    def _become(self, setup: Setup) -> None:
        before = self.robots
        self.robots = before.become(setup)
        if self.robots is not before:
            self._objective.continue_from(self.robots, self._objective)

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

    @shared
    def follow(self, route: str) -> None:
        """Moves the setpoint along a closed curve from its present position, one of `commands.ROUTES`.

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

    def _options_of(self, task: str) -> dict[str, Any]:
        """The given options, for a possibly different task: a level of tiles belongs to their ground."""
        names = set(option_names(task))
        if task != self._first_task and "terrain" not in self._task_options:
            names.discard("level")
        return {name: value for name, value in self._task_options.items() if name in names}

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
        """After a choice: the ghost continues with the new robot."""
        if self.ghost is None:
            return
        name, self.ghost = self.ghost.controller, None
        try:
            self.compare_with(name)
        except (TypeError, ValueError, OSError, TimeoutError) as error:
            self.notices.append(f"{name}, to compare with, is gone: {error}")

    def _frame(self) -> Frame:
        ghost = None if self.ghost is None else self.ghost.robots.states[0].to_array()
        is_pushed = self.pushed is not None and self.time - self.pushed[0] < PUSH_SECONDS
        push = self.pushed[1] if self.pushed is not None and is_pushed else None
        return self.robots.frame(self.time, ghost=ghost, push=push, **self._objective.shown(self.robots))
