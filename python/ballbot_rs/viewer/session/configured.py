"""What a session simulates: robots, controller, task and ground, as given at first and chosen later."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import MODELS, ROBOTS, Params, load_sensors
from ballbot_rs.control.resolve import NAMES, ResolvedController, common_task, find
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.registration import DEFAULT_TASK, env_id_of
from ballbot_rs.viewer.session.balancing import Balancing
from ballbot_rs.viewer.session.commanding import Commanding
from ballbot_rs.viewer.session.commands import objective_of
from ballbot_rs.viewer.session.drivers import Driver
from ballbot_rs.viewer.session.foreign import Watchdog, check_balances
from ballbot_rs.viewer.session.ghost import shared
from ballbot_rs.viewer.session.notices import Notices
from ballbot_rs.viewer.session.objective import Objective
from ballbot_rs.viewer.session.recording import Player
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

if TYPE_CHECKING:
    from ballbot_rs.viewer.session.session import Session

T = TypeVar("T")

MAX_ROBOTS = 64

#: Longest time of loading a policy and of its trial, s.
MAX_LOAD = 10.0


class Configured(Player):
    """The robots of a session and their choice.

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

    def reset(self, tilt: npt.ArrayLike | None = None) -> None:
        """Restarts all robots."""
        raise NotImplementedError

    def _compare_again(self) -> None:
        """After a choice: the ghost continues with the new robot."""
        raise NotImplementedError

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

    def _options_of(self, task: str) -> dict[str, Any]:
        """The given options, for a possibly different task: a level of tiles belongs to their ground."""
        names = set(option_names(task))
        if task != self._first_task and "terrain" not in self._task_options:
            names.discard("level")
        return {name: value for name, value in self._task_options.items() if name in names}
