"""The training configuration: one TOML file, checked when read."""

import dataclasses
import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from ballbot_rs import _toml
from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import CONTROLLERS, TASKS, LinearModel, Params
from ballbot_rs.control.policy_size import RECURRENT
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.family import are_several, is_family
from ballbot_rs.envs.registration import DEFAULT_TASK, description_of, env_id_of, task_of

#: Of Stable-Baselines3, CMA-ES (`training.evolution`), and of sb3-contrib the PPO of recurrent policies.
ALGORITHMS = ("PPO", "SAC", "CMA", RECURRENT)

#: The value of `symmetric` that ties a policy's weights where the robots and the policy allow it.
AUTO: Final = "auto"

#: Algorithms whose policies can be fitted to a teacher first, and whose weights can be tied.
TAUGHT: Final = ("PPO", RECURRENT)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Schedule and number of episodes of evaluations during training."""

    every_timesteps: int = 61_440
    episodes: int = 50
    #: Fraction of nominal robots, without events, with which the best policy must succeed; below it training has
    #: failed. None requires nothing.
    success: float | None = None


@dataclasses.dataclass(frozen=True)
class Teacher:
    """A classical law that the policy is fitted to before PPO continues from it; `training.teacher` has the method.

    Its steps come in addition to `total_timesteps`.
    """

    #: A law of the core, one of `controllers()`; of several, the law with the highest return in the task.
    controller: str | list[str]
    #: Its options, as for `make_controller`; of several laws, such tables by their names.
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    #: Whether the law is given each robot as events have sampled it: it is designed for its parameters and the delay of
    #: its motors, about its equilibrium, with the friction of its joints fed forward. Else it is the law of the robot
    #: before events.
    drawn: bool = False
    #: Whether the law follows the position that the task commands; else the position error is zero for each robot. The
    #: law's response to a position error cannot be learned from observations without it.
    follows_position: bool = True
    #: Whether the law follows the task's motion, a velocity smoothed over time; else what observations show, the
    #: commanded velocity and rate of the heading themselves.
    follows_motion: bool = True
    #: Whether a round continues the episodes of the last round; else each round resets all robots, and visits nothing
    #: later in an episode than its steps.
    continues: bool = False
    #: Powers of a robot's scales, by the units of `Params.scale`: their product weights its squared errors.
    weights: dict[str, float] = dataclasses.field(default_factory=dict)
    #: Least action whose squared errors are divided by it, relative to the largest action; errors of larger actions are
    #: divided by the action itself, so that a robot near rest counts as well as a robot that falls. None divides none.
    small_action: float | None = None
    #: Tilt of the true body beyond which a state does not count, rad; scaled from the paper's robot by the lean that a
    #: robot can hold. None counts all states.
    largest_tilt: float | None = None
    #: Whether an action beyond the largest is as good as the largest where the law commands the largest.
    saturates: bool = False
    #: Number of rounds: robots are driven and the actor is fitted to all states so far.
    rounds: int = 15
    #: Control steps of all environments in a round.
    steps: int = 200
    #: Of a round's fit; the learning rate falls linearly over the rounds.
    epochs: int = 6
    #: Of the last round's fit; with it, the learning rate falls linearly over all updates, to zero. None is `epochs`.
    last_epochs: int | None = None
    batch_size: int = 1024
    #: Control steps over which the fit of a recurrent policy differentiates; its state comes from all steps before.
    window: int = 24
    learning_rate: float = 1e-3
    #: Standard deviation of the noise added to the actions of half of the robots.
    noise: float = 0.1
    #: Rollouts of PPO from which only the value function learns.
    value_rollouts: int = 40

    def __post_init__(self) -> None:
        names = self.controller if isinstance(self.controller, list) else [self.controller]
        if not names or any(not isinstance(name, str) or name not in CONTROLLERS for name in names):
            known = ", ".join(CONTROLLERS)
            raise ValueError(
                f"teacher.controller = {self.controller!r} is not a controller: expected one of {known}, "
                "or a list of them"
            )
        if not isinstance(self.options, dict):
            raise ValueError(f"teacher.options = {self.options!r} must be a table")
        if isinstance(self.controller, list):
            for name, options in self.options.items():
                if name not in names or not isinstance(options, dict):
                    raise ValueError(
                        f"teacher.options.{name} = {options!r}: expected a table of options of one of "
                        f"{', '.join(names)}"
                    )
        if not isinstance(self.weights, dict):
            raise ValueError(f"teacher.weights = {self.weights!r} must be a table")
        for unit, power in self.weights.items():
            try:
                Params.paper().scale(unit)
            except ValueError as error:
                raise ValueError(f"teacher.weights: {error}") from error
            _check_number(f"teacher.weights.{unit}", power, "-4", "4")
        for name in ("drawn", "follows_position", "follows_motion", "continues", "saturates"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"teacher.{name} = {getattr(self, name)!r} must be true or false")
        least = {"rounds": 1, "steps": 1, "epochs": 1, "batch_size": 1, "window": 1, "value_rollouts": 0}
        for name, bound in least.items():
            _check_whole(f"teacher.{name}", getattr(self, name), bound)
        if self.last_epochs is not None:
            _check_whole("teacher.last_epochs", self.last_epochs, 1)
        if self.small_action is not None:
            _check_number("teacher.small_action", self.small_action, "0.001", "1")
        if self.largest_tilt is not None:
            _check_number("teacher.largest_tilt", self.largest_tilt, "0.01", "3")
        _check_number("teacher.learning_rate", self.learning_rate, "1e-9", "1")
        _check_number("teacher.noise", self.noise, "0", "1")

    @property
    def laws(self) -> dict[str, dict[str, Any]]:
        """The options of each law, by its name."""
        if isinstance(self.controller, str):
            return {self.controller: self.options}
        return {name: self.options.get(name, {}) for name in self.controller}


@dataclasses.dataclass(frozen=True)
class Refinement:
    """Evolution of the policy after its fit to a teacher; `training.refinement` has the method."""

    #: Families of robots, as the option `robot` of an environment: tables with `family`, `seed` and `ranges`.
    robots: list[dict[str, Any]]
    #: Options of the environments of whole episodes, in place of the options of the training; each robot has eight
    #: episodes in each. Without these options they have no events, and the starts of the task. `weight`, 1 by default,
    #: is how much they count among all whole episodes.
    episodes: list[dict[str, Any]] = dataclasses.field(default_factory=lambda: [{}])
    #: How many robots are always tried: those on which the mean of the search does worst, chosen again every four
    #: generations; and `others` of the rest in turn. None is all robots.
    hardest: int | None = None
    others: int = 0
    generations: int = 40
    #: Policies of a generation.
    population: int = 14
    #: Initial standard deviation of the changed numbers: relative changes of weights.
    sigma: float = 0.04

    def __post_init__(self) -> None:
        if not isinstance(self.robots, list) or not self.robots or not all(map(is_family, self.robots)):
            raise ValueError(f"refinement.robots = {self.robots!r} must be a list of families of robots")
        are_tables = isinstance(self.episodes, list) and all(isinstance(one, dict) for one in self.episodes)
        if not are_tables or not self.episodes:
            raise ValueError(f"refinement.episodes = {self.episodes!r} must be a list of tables of options")
        if any("robot" in one for one in self.episodes):
            raise ValueError(f"refinement.episodes = {self.episodes!r}: it has no robot, refinement.robots names them")
        for i, weight in enumerate(self.weights):
            _check_number(f"refinement.episodes[{i}].weight", weight, "0.001", "1000")
        if self.hardest is not None:
            _check_whole("refinement.hardest", self.hardest, 1)
        elif self.others:
            raise ValueError(f"refinement.others = {self.others}: without refinement.hardest all robots are kept")
        _check_whole("refinement.others", self.others, 0)
        _check_whole("refinement.generations", self.generations, 1)
        _check_whole("refinement.population", self.population, 4)
        _check_number("refinement.sigma", self.sigma, "1e-6", "1")

    @property
    def weights(self) -> list[float]:
        """How much each kind of whole episodes counts."""
        return [one.get("weight", 1.0) for one in self.episodes]

    @property
    def episode_options(self) -> list[dict[str, Any]]:
        """The options of the environments of each kind of whole episodes."""
        return [{name: value for name, value in one.items() if name != "weight"} for one in self.episodes]


#: Algorithm arguments that are counts, and those from 0 to 1: a learner accepts other values, but learns nothing.
WHOLE_ARGUMENTS: Final = ("n_steps", "batch_size", "n_epochs")
SHARES: Final = ("gamma", "gae_lambda", "tau")


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """Configuration of `ballbot train`; the fields are the keys of the TOML file."""

    env_id: str = TASKS[DEFAULT_TASK]["id"]
    algorithm: str = "PPO"
    total_timesteps: int = 400_000
    #: A run that has not reached `evaluation.success` continues to at most this many steps; None ends it.
    max_timesteps: int | None = None
    num_envs: int = 128
    num_threads: int | None = None
    torch_threads: int = 1
    #: Scale of the rewards that the learner sees; evaluations have the task's rewards.
    reward_scale: float = 1.0
    #: Discount time of the rewards, in units of the time in which the robot's tilt grows by a factor of e, since that
    #: differs between robots. None, or a `gamma` among the arguments, is the algorithm's discount.
    horizon: float | None = None
    env: dict[str, Any] = dataclasses.field(default_factory=dict)
    #: Options of the environment for the paper's robot; for another robot they are scaled as its defaults are. Options
    #: in `env`, which then has all of them, come first.
    scaled: dict[str, Any] = dataclasses.field(default_factory=dict)
    evaluation: Evaluation = dataclasses.field(default_factory=Evaluation)
    #: None learns only from rewards.
    teacher: Teacher | None = None
    #: None keeps the fit as it is.
    refinement: Refinement | None = None
    #: Whether the policy has the symmetries of three equal wheels 120 degrees apart exactly: turned and mirrored robots
    #: get turned and mirrored torques (`training.tied`). Hidden layers then have multiples of 6 units. "auto" is true
    #: where robots, observations and hidden layers have the symmetries. `CMA` has an argument of the same name.
    symmetric: bool | str = False
    #: Whether a symmetric policy is odd, as linear laws are: the opposite motion gets reversed torques. Its actor has
    #: no biases, and cannot use the rows that the opposite motion has alike: the vertical component of gravity and
    #: the distance of a goal. Only for `PPO` with tanh, the default.
    odd: bool = False
    algorithm_arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    schedule: dict[str, str] = dataclasses.field(default_factory=dict)
    policy: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        task_of(self.env_id)
        for name in ("env", "scaled", "algorithm_arguments", "schedule", "policy"):
            if not isinstance(getattr(self, name), dict):
                raise ValueError(f"{name} = {getattr(self, name)!r} must be a table")
        if self.scaled:
            object.__setattr__(self, "env", self._fitted() | self.env)
        if self.algorithm not in ALGORITHMS:
            raise ValueError(f"unknown algorithm '{self.algorithm}': expected one of {', '.join(ALGORITHMS)}")
        counts = {
            "total_timesteps": self.total_timesteps,
            "num_envs": self.num_envs,
            "torch_threads": self.torch_threads,
            "num_threads": 1 if self.num_threads is None else self.num_threads,
            "evaluation.every_timesteps": self.evaluation.every_timesteps,
            "evaluation.episodes": self.evaluation.episodes,
        }
        for name, value in counts.items():
            _check_whole(name, value, 1)
        _check_number("reward_scale", self.reward_scale, "1e-6", "1e6")
        if self.horizon is not None:
            _check_number("horizon", self.horizon, "0.01", "1e6")
        if self.evaluation.success is not None:
            _check_number("evaluation.success", self.evaluation.success, "0", "1")
        if self.max_timesteps is not None:
            _check_whole("max_timesteps", self.max_timesteps, 1)
            if self.max_timesteps < self.total_timesteps:
                raise ValueError(
                    f"max_timesteps = {self.max_timesteps} is below total_timesteps = {self.total_timesteps}"
                )
        if self.teacher is not None and self.algorithm not in TAUGHT:
            raise ValueError(f"teacher: not available for {self.algorithm}, only for {' and '.join(TAUGHT)}")
        if self.refinement is not None and self.algorithm != "PPO":
            raise ValueError(f"refinement: not available for {self.algorithm}, only for PPO")
        if not isinstance(self.symmetric, bool) and self.symmetric != AUTO:
            raise ValueError(f"symmetric = {self.symmetric!r} must be true, false or '{AUTO}'")
        if self.symmetric is True and self.algorithm not in TAUGHT:
            raise ValueError(f"symmetric = true: {self.algorithm} has no such policies, only {' and '.join(TAUGHT)}")
        if not isinstance(self.odd, bool):
            raise ValueError(f"odd = {self.odd!r} must be true or false")
        if self.odd and (self.algorithm != "PPO" or self.symmetric is not True):
            given = f"algorithm = '{self.algorithm}', symmetric = {self.symmetric!r}"
            raise ValueError(f"odd = true with {given}: expected algorithm = 'PPO', symmetric = True")
        for name, kind in self.schedule.items():
            if kind != "linear":
                raise ValueError(f"schedule.{name} = '{kind}': expected 'linear'")
            if name not in self.algorithm_arguments:
                raise ValueError(f"schedule.{name} has no value of that name in algorithm_arguments")
            initial = self.algorithm_arguments[name]
            if not isinstance(initial, (int, float)):
                raise ValueError(f"algorithm_arguments.{name} = {initial!r}: a scheduled value must be a number")
        for name, value in self.algorithm_arguments.items():
            if name in WHOLE_ARGUMENTS:
                _check_whole(f"algorithm_arguments.{name}", value, 1)
            elif name in SHARES:
                _check_number(f"algorithm_arguments.{name}", value, "0", "1")

    @property
    def most_timesteps(self) -> int:
        """Steps after which the run ends, whatever its policy achieves."""
        return self.total_timesteps if self.max_timesteps is None else self.max_timesteps

    def arguments(self) -> dict[str, Any]:
        """Arguments of the algorithm, with the discount derived from the robot.

        Raises:
            ValueError: the options are invalid for an environment.
        """
        given = dict(self.algorithm_arguments)
        if self.horizon is not None and "gamma" not in given:
            if are_several(self.env.get("robot")):
                raise ValueError("horizon follows from one robot: with several, give algorithm_arguments.gamma")
            batch = new_batch(1, task=task_of(self.env_id), num_threads=1, options=self.env)
            rate = math.sqrt(LinearModel(batch.nominal_params(0)).toppling_squared)
            given["gamma"] = max(1.0 - batch.control_dt * rate / self.horizon, 0.0)
        return given

    def _fitted(self) -> dict[str, Any]:
        """`scaled` for the robot of the environment: torques by what its wheels transmit, all else by its units."""
        task = task_of(self.env_id)
        if are_several(self.env.get("robot")):
            raise ValueError("scaled: options for one robot, not for several: leave it out, or set scale_by_robot")
        given = {name: value for name, value in self.env.items() if name == "robot"}
        own, paper = (new_batch(1, task=task, num_threads=1, options=options) for options in (given, {}))
        robot = own.nominal_params(0)
        factors = {option["name"]: robot.scale(option["unit"]) for option in description_of(task)["options"]}
        factors |= {
            "max_wheel_torque": own.max_wheel_torque / paper.max_wheel_torque,
            "max_episode_steps": robot.scale("s"),
        }
        fitted: dict[str, Any] = {}
        for name, value in self.scaled.items():
            if name not in factors:
                raise ValueError(f"scaled.{name} = {value!r} does not scale: expected one of {', '.join(factors)}")
            try:
                fitted[name] = (np.asarray(value, dtype=np.float64) * factors[name]).tolist()
            except (TypeError, ValueError):
                raise ValueError(f"scaled.{name} = {value!r} must be a number or a list of numbers") from None
        if "max_episode_steps" in fitted:
            fitted["max_episode_steps"] = round(fitted["max_episode_steps"])
        if "max_wheel_torque" in fitted:
            fitted["max_wheel_torque"] = min(fitted["max_wheel_torque"], robot.max_wheel_torque)
        return fitted


def _check_whole(name: str, value: Any, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} = {value!r} is out of range: it must be a whole number of at least {least}")


def _check_number(name: str, value: Any, least: str, most: str) -> None:
    """Raises ValueError unless a number is between `least` and `most`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not float(least) <= value <= float(most):
        raise ValueError(f"{name} = {value!r} is out of range: it must be from {least} to {most}")


def parse(text: str, source: str) -> TrainConfig:
    """A configuration from TOML text; `source` is its name in messages.

    Raises:
        ValueError: malformed TOML, a missing or unknown key, or a value out of range.
    """
    try:
        table = _toml.loads(text)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    if not table:
        known = ", ".join(field.name for field in dataclasses.fields(TrainConfig))
        raise ValueError(f"{source}: it is empty, expected at least one of {known}")
    _check_keys(source, table, TrainConfig)
    inner = {"evaluation": Evaluation, "teacher": Teacher, "refinement": Refinement}
    for name, kind in inner.items():
        if name in table:
            if not isinstance(table[name], dict):
                raise ValueError(f"{source}: {name} = {table[name]!r} must be a table")
            _check_keys(f"{source}: [{name}]", table[name], kind)
    if "controller" not in table.get("teacher", {"controller": None}):
        raise ValueError(f"{source}: [teacher]: it has no controller, expected one of {', '.join(CONTROLLERS)}")
    if "robots" not in table.get("refinement", {"robots": None}):
        raise ValueError(f"{source}: [refinement]: it has no robots, expected a list of families of robots")
    try:
        table |= {name: kind(**table[name]) for name, kind in inner.items() if name in table}
        return TrainConfig(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{source}: {error}") from error


def _check_keys(source: str, table: dict[str, Any], kind: type) -> None:
    known = [field.name for field in dataclasses.fields(kind)]
    for key in table:
        if key not in known:
            hint = did_you_mean(key, known)
            raise ValueError(f"{source}: unknown key '{key}': expected one of {', '.join(known)}{hint}")


def default_text(task: str, variant: str | None = None) -> str:
    """The TOML text of a task's own configuration, or of a variant that comes with the package.

    A task in Python is trained as balance is, but with a fixed number of steps and no required success.

    Raises:
        ValueError: there is no such task, or the package has no configuration for it.
    """
    env_id_of(task)
    if task not in TASKS and variant is None:
        return _text_of_own_task(task)
    name = task if variant is None else f"{task}-{variant}"
    path = resources.files(__package__) / "configs" / f"{name}.toml"
    if path.is_file():
        return path.read_text(encoding="utf-8")
    if variant is None:
        raise ValueError(f"no training configuration of the task '{task}' comes with the package: use --config")
    known = ", ".join(_variants(task)) or "none"
    raise ValueError(f"--config {variant}: there is no such file, nor a variant of the task {task} (it has: {known})")


def _text_of_own_task(task: str) -> str:
    table = _toml.loads(default_text(DEFAULT_TASK))
    del table["max_timesteps"], table["evaluation"]["success"]
    return _toml.dumps({**table, "env_id": env_id_of(task)})


def _variants(task: str) -> list[str]:
    folder = resources.files(__package__) / "configs"
    names = (path.name.removesuffix(".toml") for path in folder.iterdir())
    return sorted(name.removeprefix(f"{task}-") for name in names if name.startswith(f"{task}-"))


def load(task: str, path: Path | None = None, robot: str | None = None) -> tuple[TrainConfig, str]:
    """A task's configuration and its text, from `path` or from the package.

    Args:
        task: name of the task.
        path: a file, or the name of a variant that comes with the package; None is the robot's variant where there is
            one, else the task's own configuration.
        robot: name of a robot.

    Raises:
        ValueError: as `parse`, or a configuration of another task.
        OSError: the file cannot be read.
    """
    env_id = env_id_of(task)
    if path is not None and not path.suffix and len(path.parts) == 1 and not path.exists():
        text, source = default_text(task, str(path)), f"{task}-{path}.toml"
    elif path is not None:
        text, source = path.read_text(encoding="utf-8"), str(path)
    elif robot in _variants(task):
        text, source = default_text(task, robot), f"{task}-{robot}.toml"
    else:
        text, source = default_text(task), f"{task}.toml"
    config = parse(text, source)
    if config.env_id != env_id:
        raise ValueError(f"{path} is of {config.env_id}, but the task is {task} ({env_id})")
    return config, text


def with_values(text: str, values: Mapping[str, Any]) -> str:
    """The text with other values, so that a run keeps the configuration that it used.

    Args:
        text: TOML; its comments are lost if there are values.
        values: by dotted name, for example `env.model`.

    Raises:
        ValueError: a name inside a value that is not a table.
    """
    if not values:
        return text
    table = _toml.loads(text)
    for name, value in values.items():
        *path, last = name.split(".")
        inner = table
        for part in path:
            inner = inner.setdefault(part, {})
            if not isinstance(inner, dict):
                raise ValueError(f"{name} = {value!r}: {part} is not a table")
        inner[last] = value
    return _toml.dumps(table)


def steps_alone(config: TrainConfig, timesteps: int) -> dict[str, int]:
    """Values of a configuration with exactly this number of steps."""
    most = {} if config.max_timesteps is None else {"max_timesteps": timesteps}
    return {"total_timesteps": timesteps, **most}
