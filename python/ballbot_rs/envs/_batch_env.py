"""Shared by the front ends: a batch of environments, its attributes, and how it is copied and pickled."""

import copy
import functools
import secrets
from collections.abc import Iterable, Mapping
from os import PathLike
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_count, check_seed, real_array
from ballbot_rs._core import ROBOTS, TASKS, Batch, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import check_keywords
from ballbot_rs._robot import params_of
from ballbot_rs.envs.family import are_several, at_most, check_room, is_family, is_list, robots_of
from ballbot_rs.envs.own import registry
from ballbot_rs.envs.own.stage import FUNCTION_OPTIONS, Stage, split
from ballbot_rs.envs.own.task import BARE, NO_TIME_LIMIT, Task
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of, env_id_of, name_of

#: Options that may name a file with a table.
_TABLES: Final = ("actuators", "sensors", "events")


def new_batch(
    num_envs: int,
    *,
    task: str = DEFAULT_TASK,
    autoreset: str = "same_step",
    num_threads: int | None = None,
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
    stage: Stage | None = None,
) -> Batch:
    """A batch of a task of the core or in Python.

    Args:
        num_envs: as for `Batch`, as `autoreset`, `num_threads` and `seed`.
        task: its name.
        autoreset: see above.
        num_threads: see above.
        seed: see above.
        options: of its environments. `robot` is as in `Batch`, or a family (a
            dict with the keys `family`, the number of robots, and `seed`), or a list of robots, of which eight
            neighbors have the same; `max_episode_steps` may be None, and the values of `FUNCTION_OPTIONS` functions.
        stage: the stage of a batch with the same task and options; None makes a new stage.
    """
    env_id_of(task)
    own = registry.find(task)
    given = dict(options or {}) if own is None else {**own.options, **(options or {})}
    if given:
        check_keywords(f"the environment of {task}", given, option_names(task))
    given, functions = split(given)
    arguments = {} if own is None else {name: given.pop(name) for name in own.parameters() if name in given}
    made = None if own is None else own.made_by(**arguments)
    core = _plain(given, num_envs)
    core = core if made is None else _of_own_task(made, core)
    name = task if made is None else made.base or BARE
    if stage is None and (made is not None or functions):
        stage = Stage(
            Batch(1, name, num_threads=1, **core),
            num_envs,
            task=made,
            name=None if made is None else task,
            options=arguments,
            functions=functions,
        )
    return Batch(num_envs, name, autoreset=autoreset, num_threads=num_threads, seed=seed, stage=stage, **core)


def _of_own_task(made: Task, options: dict[str, Any]) -> dict[str, Any]:
    """Options for the core of a task in Python."""
    steps = NO_TIME_LIMIT if made.max_episode_steps is None else made.max_episode_steps
    options = {"max_episode_steps": steps, **options}
    if made.base is not None:
        scales = dict.fromkeys((term["name"] for term in TASKS[made.base]["rewards"]), 0.0)
        return {**options, "reward": {**scales, **options.get("reward", {})}}
    options = {"scale_observations": False, **options}
    tilt = options.pop("fall_tilt", None)
    if tilt is not None and tilt != Batch(1, BARE, num_threads=1).options["fall_tilt"]:
        raise InvalidInputError("fall_tilt: the method `terminated` of a task in Python defines a fall")
    return options


def _plain(options: Mapping[str, Any], num_envs: int) -> dict[str, Any]:
    """Options in the form that the core takes."""
    plain = decided(options)
    if "robot" in plain:
        plain["robot"] = _robot_or_robots(plain.pop("robot"), num_envs)
    if "max_episode_steps" in plain and plain["max_episode_steps"] is None:
        plain["max_episode_steps"] = NO_TIME_LIMIT
    return plain


def decided(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options without a choice that is left to the policy, or to the default, by None."""
    undecided = [name for name in ("robot", "model", "observation") if options.get(name) is None]
    return {name: value for name, value in options.items() if name not in undecided}


def _robot_or_robots(robot: Any, num_envs: int) -> Any:
    if is_family(robot):
        return robots_of(robot, num_envs)
    return [_robot_or_robots(one, 1) for one in at_most(robot, num_envs)] if is_list(robot) else params_of(robot)


def option_names(task: str) -> tuple[str, ...]:
    """Names of the options of a task and of its environments."""
    own = registry.find(task)
    return _option_names(task) if own is None else (*options_of_own_tasks(own.made_by.base), *own.parameters())


def options_of_own_tasks(base: str | None) -> tuple[str, ...]:
    """Names of the options common to environments of all tasks in Python on a base."""
    return _option_names(base or BARE)


@functools.cache
def _option_names(task: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(("robot", "model", *Batch(1, task, num_threads=1).options, *FUNCTION_OPTIONS)))


def has_fall_tilt(task: str) -> bool:
    """Whether the tilt of a fall is an option of the task; else its method `terminated` defines a fall."""
    own = registry.find(task)
    return "fall_tilt" in option_names(task) and (own is None or own.made_by.base is not None)


def task_metrics(batch: Batch, *, present: bool = False) -> npt.NDArray[np.float64]:
    """Metrics of all robots, shape (num_envs, k): of the core, then of a task in Python.

    Args:
        batch: the robots.
        present: as `Batch.running_metrics`; else as `Batch.metrics`.
    """
    found = (batch.running_metrics() if present else batch.metrics()).reshape(batch.num_envs, -1)
    own = None if batch.stage is None else batch.stage.metrics
    return found if own is None else np.hstack([found, own.present() if present else own.last()])


def metric_names(task: str) -> list[str]:
    """Names of the columns of `task_metrics`."""
    return [metric["name"] for metric in description_of(task)["metrics"]]


def resolved_options(batch: Batch, given: Mapping[str, Any]) -> dict[str, Any]:
    """All options of a batch made with the given options, defaults included, as JSON values."""
    options: dict[str, Any] = {"model": batch.model, **batch.options}
    if options["max_episode_steps"] == NO_TIME_LIMIT:
        options["max_episode_steps"] = None
    several = are_several(given.get("robot"))
    if (several or options["scale_by_robot"]) and given.get("max_wheel_torque") is None:
        # It follows from each robot.
        options["max_wheel_torque"] = None
    if "robot" in given:
        options["robot"] = _as_json(given["robot"])
        if several:
            # They follow from each robot, too.
            fitted = {option["name"] for option in description_of(batch.task)["options"] if option["scaled"]}
            options = {name: value for name, value in options.items() if name not in fitted or name in given}
    return options if batch.stage is None else batch.stage.options(options)


def _as_json(robot: Any) -> Any:
    """The value of an option `robot` as JSON, without files: a file may change, and no other machine has it."""
    if is_list(robot):
        return [_as_json(one) for one in robot]
    if isinstance(robot, (str, PathLike)):
        return robot if robot in ROBOTS else params_of(robot).to_dict()
    if isinstance(robot, Params):
        return robot.to_dict()
    return dict(robot) if isinstance(robot, Mapping) else robot


def without_curriculum(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options for evaluation, from training options: episodes begin on any level of the terrain."""
    return {name: value for name, value in options.items() if (name, value) != ("level", "curriculum")}


def fixed_option(task: str, name: str) -> str | None:
    """The reason why an option of the task cannot be set as an attribute; None for other names."""
    if name in ("robot", "params"):
        return f"{name} cannot be set as an attribute: call set_params"
    is_option = name in option_names(task)
    return f"{name} is fixed once an environment is made: make a new environment with {name}=..." if is_option else None


class BatchAttributes:
    """Attributes of one robot of a batch, or of all robots, with arrays whose first axis is over robots."""

    _batch: Batch
    #: Number of the robot; None is all robots.
    _index: int | None = None

    @property
    def model(self) -> str:
        """Name of the simulated model."""
        return self._batch.model

    @property
    def sim_dt(self) -> float:
        """Time step of the simulation, s."""
        return self._batch.sim_dt

    @property
    def control_dt(self) -> float:
        """Control period, s."""
        return self._batch.control_dt

    @property
    def max_wheel_torque(self) -> float:
        """Torque of a wheel motor at an action of 1, N·m; of the first of all robots."""
        return float(self._batch.action_torques[self._index or 0])

    @property
    def observation_layout(self) -> dict[str, tuple[int, ...]]:
        """Parts of an observation by name, in order, with their shapes; see `Batch.observation_layout`."""
        return self._batch.observation_layout

    @property
    def params(self) -> Params:
        """Parameters of the robot, or of the first of all robots: events and `set_params` may change a single robot."""
        return self._batch.params(self._index or 0)

    @property
    def nominal_params(self) -> Params:
        """`params` without events, which controllers use."""
        return self._batch.nominal_params(self._index or 0)

    def draws(self) -> dict[str, Any]:
        """Samples of the events, by term, each a number or an array; see `Batch.draws`."""
        return self._batch.draws(self._index)

    def readings(self) -> dict[str, npt.NDArray[np.float64]]:
        """Last readings of the sensors by name, shape (3,) or (num_envs, 3) each; see `Batch.readings`."""
        return self._batch.readings(self._index)

    def privileged_observations(self) -> npt.NDArray[np.float32]:
        """The rows of the observations from the true states; see `Batch.privileged_observations`."""
        return self._batch.privileged_observations(self._index)


class OneRobot(BatchAttributes):
    """One robot of a batch."""

    _index: int = 0

    @property
    def state(self) -> State:
        """The robot's full state; the observation is a part of it."""
        return self._batch.state(self._index)

    @property
    def command(self) -> npt.NDArray[np.float64]:
        """The current command, shape (k,), its parts as in `TASKS[task]["command"]`.

        A command that is set holds from the next observation to the end of the episode.
        """
        return self._batch.command(self._index)

    @command.setter
    def command(self, value: npt.ArrayLike) -> None:
        self._batch.set_command(self._index, value)

    def metrics(self) -> dict[str, float]:
        """Metrics of the episode so far, by name; before its first step, of the last episode. See `Batch.metrics`."""
        return dict(zip(metric_names(self._batch.task), task_metrics(self._batch)[self._index].tolist(), strict=True))

    @property
    def is_success(self) -> bool:
        """Whether an episode that ended with the last step would be a success."""
        return self._batch.ending(self._index)[0]

    def reward_terms(self) -> dict[str, float]:
        """The terms that sum to the last reward; zeros right after a reset."""
        return self._batch.reward_terms(self._index)

    def perceived(self, name: str) -> npt.NDArray[np.float32]:
        """Last reading of an instrument, in the shape of `observation_layout`; see `Batch.perceived`."""
        return self._batch.perceived(name, self._index)

    def push(self, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None) -> None:
        """Gives the body an impulse; see `Ballbot.push`."""
        self._batch.push(self._index, impulse, point)

    def apply_force(
        self,
        force: npt.ArrayLike,
        point: npt.ArrayLike | None = None,
        *,
        frequency: float = 0.0,
        phase: float = 0.0,
        delay: float = 0.0,
        duration: float | None = None,
    ) -> None:
        """Replaces the external force on the body; see `Ballbot.apply_force`."""
        self._batch.apply_force(
            self._index, force, point, frequency=frequency, phase=phase, delay=delay, duration=duration
        )

    def set_params(self, params: Params | str) -> None:
        """Replaces the robot's parameters; see `Batch.set_params`."""
        self._batch.set_params(self._index, params)


class ManyRobots(BatchAttributes):
    """All robots of a batch."""

    @property
    def command(self) -> npt.NDArray[np.float64]:
        """The current commands, shape (num_envs, k), their parts as in `TASKS[task]["command"]`.

        Setting them, to one for all robots or one each, holds them from the next observations to the ends of the
        episodes.
        """
        return self._batch.command()

    @command.setter
    def command(self, value: npt.ArrayLike) -> None:
        num_envs, parts = self._batch.num_envs, len(description_of(self._batch.task)["command"])
        if parts == 0:
            raise InvalidInputError(f"the task {self._batch.task} has no command")
        given = real_array("command is", value, "numbers").astype(np.float64, copy=False)
        if given.shape not in ((parts,), (num_envs, parts)):
            raise InvalidInputError(f"command has shape {given.shape}, expected ({parts},) or ({num_envs}, {parts})")
        commands = np.broadcast_to(given, (num_envs, parts))
        before, done = self._batch.command(), 0
        try:
            for done, command in enumerate(commands):
                self._batch.set_command(done, command)
        except ValueError:
            # All or none.
            for i in range(done):
                self._batch.set_command(i, before[i])
            raise

    def metrics(self) -> dict[str, npt.NDArray[np.float64]]:
        """Metrics of the episodes so far, by name, shape (num_envs,); see `Batch.metrics`."""
        return dict(zip(metric_names(self._batch.task), task_metrics(self._batch).T, strict=True))

    def set_params(self, params: Params | str, index: int | None = None) -> None:
        """Replaces the parameters of robot `index`, or of every robot; see `Batch.set_params`."""
        for i in self._chosen_indices(index):
            self._batch.set_params(i, params)

    @property
    def state(self) -> tuple[State, ...]:
        """Full state of each robot."""
        return tuple(self._batch.state(i) for i in range(self._batch.num_envs))

    @property
    def states(self) -> npt.NDArray[Any]:
        """Full states, shape (num_envs, 32), rows as in `State.to_array`."""
        return self._batch.states()

    def perceived(self, name: str) -> npt.NDArray[np.float32]:
        """Last readings of an instrument, first axis over robots; see `Batch.perceived`."""
        return self._batch.perceived(name)

    def levels(self) -> npt.NDArray[np.int64]:
        """Levels of the tiles of the terrain that the episodes began on, shape (num_envs,); see `Batch.levels`."""
        return self._batch.levels()

    def push(self, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None, index: int | None = None) -> None:
        """Gives the body of robot `index` an impulse, or of every robot; see `Ballbot.push`."""
        for i in self._chosen_indices(index):
            self._batch.push(i, impulse, point)

    def apply_force(
        self,
        force: npt.ArrayLike,
        point: npt.ArrayLike | None = None,
        index: int | None = None,
        *,
        frequency: float = 0.0,
        phase: float = 0.0,
        delay: float = 0.0,
        duration: float | None = None,
    ) -> None:
        """Replaces the force on the body of robot `index`, or of every robot; see `Ballbot.apply_force`."""
        for i in self._chosen_indices(index):
            self._batch.apply_force(i, force, point, frequency=frequency, phase=phase, delay=delay, duration=duration)

    def _chosen_indices(self, index: int | None) -> Iterable[int]:
        return range(self._batch.num_envs) if index is None else (index,)


class BatchEnv(BatchAttributes):
    """Owns a `Batch` and carries it through `copy` and `pickle` with all the state that later steps depend on."""

    task: str

    def _make_batch(
        self,
        num_envs: int,
        options: dict[str, Any],
        *,
        task: str = DEFAULT_TASK,
        autoreset: str,
        num_threads: int | None,
        seed: int | None,
    ) -> None:
        task = name_of(task)
        self.task = task
        check_count("num_envs", num_envs)
        self._check_names(options)
        if options.get("max_episode_steps") is not None:
            check_count("max_episode_steps", options["max_episode_steps"])
        if num_threads is not None:
            check_count("num_threads", num_threads)
        check_room(options.get("robot"), num_envs)
        if "robot" in options:
            options = {**options, "robot": _as_json(options["robot"])}
        self._first_seed = secrets.randbits(63) if seed is None else check_seed(seed)
        self._batch = new_batch(
            num_envs, task=task, autoreset=autoreset, num_threads=num_threads, seed=self._first_seed, options=options
        )
        # A copy of the environment must not depend on files, either.
        named = {name: self._batch.options[name] for name in _TABLES if isinstance(options.get(name), (str, PathLike))}
        self._batch_arguments = (num_envs, task, autoreset, num_threads, {**options, **named})

    def _termination_names(self) -> list[str]:
        """Names for the numbers of `termination` in infos."""
        return ["none", *(name for name, _ in self._batch.terminations)]

    def _check_names(self, options: Mapping[str, Any]) -> None:
        check_keywords(type(self).__name__, options, option_names(self.task), self._hint)

    def _hint(self, name: str) -> str:  # noqa: ARG002
        return ""

    @property
    def task_options(self) -> dict[str, Any]:
        """All options of the environment, defaults included, as JSON values."""
        return resolved_options(self._batch, self._batch_arguments[-1])

    def __copy__(self) -> "BatchEnv":
        # A shallow copy would share the memory of functions and tasks in Python.
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        batch = state.pop("_batch")
        state.pop("_renderer", None)
        state["_snapshots"] = [batch.snapshot(i) for i in range(batch.num_envs)]
        state["_stage"], state["_is_interrupted"] = batch.stage, batch.is_interrupted
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshots, stage, is_interrupted = (state.pop(name) for name in ("_snapshots", "_stage", "_is_interrupted"))
        self.__dict__.update(state)
        num_envs, task, autoreset, num_threads, options = self._batch_arguments
        self._batch = new_batch(
            num_envs, task=task, autoreset=autoreset, num_threads=num_threads, options=options, stage=stage
        )
        for i, snapshot in enumerate(snapshots):
            self._batch.restore(i, snapshot)
        if is_interrupted:
            self._batch.interrupt()
