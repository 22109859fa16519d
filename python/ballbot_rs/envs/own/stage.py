"""The part of a batch that is Python: a custom task, and functions that are added to a task of the core."""

import dataclasses
import importlib
import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import real_array
from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.envs.own.metrics import EpisodeMetrics, check_declared
from ballbot_rs.envs.own.robots import COLUMNS, WIDTH, Robots
from ballbot_rs.envs.own.task import Task

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
#: A function of all robots.
Function = Callable[[Robots], npt.ArrayLike]
#: Resets the memory of the robots that begin an episode, as `Task.reset`.
Reset = Callable[[Robots, npt.NDArray[np.intp], list[np.random.Generator]], object]

#: Options whose values may be functions, by name.
FUNCTION_OPTIONS: Final = ("reward", "rows", "terminations")

#: Largest magnitude of a term of the reward, so that its sums are finite.
MOST: Final = 1e9

#: Bound of the magnitude of rows that functions compute.
BOUND: Final = 1e3


@dataclasses.dataclass(frozen=True)
class Part:
    """A function with its name in errors."""

    label: str
    call: Function


@dataclasses.dataclass(frozen=True)
class Rows(Part):
    """A function of some rows of the observation, with the shape of its result for each robot."""

    shape: tuple[int, ...]

    @property
    def width(self) -> int:
        """How many rows."""
        return math.prod(self.shape)


class Stage:
    """Reward terms, observation rows and terminations that Python computes for all robots at once.

    The core reads the public attributes when a batch is made, and then calls `begin`, `step` and `observe` with arrays
    of the robots; see `ROBOT_ROW_LEN` and `RobotRows` in the core.
    """

    def __init__(
        self,
        one: Batch,
        num_envs: int,
        *,
        task: Task | None = None,
        name: str | None = None,
        options: Mapping[str, Any] | None = None,
        functions: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        """Calls `reset` and `observe` of the task and the functions of rows once, to count rows.

        Args:
            one: a batch of one robot without the stage.
            num_envs: robots of the batch.
            task: a task in Python.
            name: its id.
            options: its arguments.
            functions: functions by name, for each of `FUNCTION_OPTIONS`.
        """
        self.task = task
        self._options = dict(options or {})
        self._control_dt = one.control_dt
        #: Texts of the functions.
        self._texts: dict[str, dict[str, str]] = {}
        found: dict[str, list[tuple[str, Part]]] = {option: [] for option in FUNCTION_OPTIONS}
        self._resets: list[Reset] = []
        self._success: Part | None = None
        self._metrics: Callable[[Robots], Mapping[str, npt.ArrayLike]] | None = None
        if task is not None:
            method = f"{type(task).__name__}.".__add__
            found["reward"].append(("reward", Part(method("reward"), task.reward)))
            if task.base is None or type(task).observe is not Task.observe:
                found["rows"].append(("observation", Part(method("observe"), task.observe)))
            found["terminations"].append(("task", Part(method("terminated"), task.terminated)))
            if type(task).reset is not Task.reset:
                self._resets.append(task.reset)
            if type(task).success is not Task.success:
                self._success = Part(method("success"), task.success)
            if type(task).metrics is not Task.metrics:
                self._metrics = task.metrics
        for option, by_name in (functions or {}).items():
            for of, given in by_name.items():
                label = f"{option}.{of}"
                call, text = _function(label, given)
                found[option].append((of, Part(label, call)))
                self._texts.setdefault(option, {})[of] = text
                if callable(reset := getattr(call, "reset", None)):
                    if option == "rows":
                        # They are also computed for privileged observations, and again where a command changes.
                        raise InvalidInputError(
                            f"{label} keeps state: rows may depend only on the robots in the current step"
                        )
                    self._resets.append(reset)
        self._rewards = [part for _, part in found["reward"]]
        self._ends = [part for _, part in found["terminations"]]
        #: The robots of the last call.
        self._present = robots = self._at_rest(one, num_envs)
        for reset in self._resets:
            reset(robots, robots.numbers, [np.random.default_rng(i) for i in range(num_envs)])
        #: Names in rewards, with their scales.
        self.terms = [(of, 1.0) for of, _ in found["reward"]]
        #: Name, unit, bound and typical magnitude of each row.
        self.rows: list[tuple[str, str, float, float]] = []
        self._rows: list[Rows] = []
        for of, part in found["rows"]:
            of_task = task if part.call == getattr(task, "observe", None) else None
            rows = _rows(part, robots, needs_columns=of_task is not None)
            bounds = [BOUND] * rows.width if of_task is None else _bounds(of_task, rows.width)
            names = [f"{of} {i}" for i in range(rows.width)] if rows.shape else [of]
            if of_task is not None and of_task.row_names is not None:
                names = _named(of_task, rows.width)
            self.rows += [(each, "", bound, 1.0) for each, bound in zip(names, bounds, strict=True)]
            self._rows.append(rows)
        #: Names of the reasons for termination, with their conditions.
        self.terminations = [(of, f"`{part.label}` returns True") for of, part in found["terminations"]]
        #: Metrics of a task over each robot's episode; None without.
        self.metrics: EpisodeMetrics | None = None
        if task is not None:
            names = [] if self._metrics is None else list(self._measured(robots))
            check_declared(names, task.summaries, task.units)
            if self._metrics is not None:
                self.metrics = EpisodeMetrics(names, num_envs, task.summaries)
        #: Name of the task; None: as in the core.
        self.name = name
        #: Whether the stage, not the task of the core, decides whether an episode is a success.
        self.decides_success = self._success is not None

    @property
    def takes_clicks(self) -> bool:
        """Whether a task in Python takes clicks on the floor."""
        return self.task is not None and type(self.task).click is not Task.click

    def click(self, point: FloatArray) -> None:
        """A click on the floor, shape (2,), m, for the robots of the last step."""
        assert self.task is not None
        self.task.click(self._present, point)

    def drawing(self) -> FloatArray | None:
        """Points of a line on the ground for each robot of the last step, m, shape (n, k, 2); None without."""
        if self.task is None or type(self.task).drawing is Task.drawing:
            return None
        label, n = f"{type(self.task).__name__}.drawing", len(self._present)
        found = real_array(f"{label} returned", self.task.drawing(self._present), "numbers")
        if found.ndim != 3 or found.shape[::2] != (n, 2) or found.shape[1] == 0:
            raise InvalidInputError(
                f"{label} returned shape {found.shape}, expected ({n}, k, 2): points (x, y) of a line"
            )
        return found.astype(np.float64)

    @property
    def has_memory(self) -> bool:
        """Whether it may keep something of a robot from step to step."""
        return self.task is not None or bool(self._resets)

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics of a task in Python."""
        return () if self.metrics is None else self.metrics.names

    def options(self, core: Mapping[str, Any]) -> dict[str, Any]:
        """Options of the batch with the options of the stage, functions as "module:name"."""
        texts: dict[str, Any] = dict(self._texts)
        if "reward" in texts:
            texts["reward"] = {**core["reward"], **texts["reward"]}
        return {**core, **self._options, **texts}

    def begin(self, *arrays: npt.NDArray[Any]) -> FloatArray:
        """Begins episodes of some robots; their rows."""
        true, seen = self._robots(*arrays)
        if self.metrics is not None:
            self.metrics.begin(true.numbers)
        if self._resets:
            # Seeds and episodes decide, so that a robot does the same alone and among others.
            rngs = [np.random.default_rng(key) for key in arrays[-1]]
            for reset in self._resets:
                reset(true, true.numbers, rngs)
        return self._observe(seen)

    def step(self, *arrays: npt.NDArray[Any]) -> tuple[FloatArray, npt.NDArray[np.int64], BoolArray, FloatArray]:
        """Terms of the rewards, codes of terminations, successes, and rows of all robots after a step."""
        true, seen = self._robots(*arrays)
        n = len(true)
        terms = np.empty((n, len(self._rewards)))
        for i, part in enumerate(self._rewards):
            terms[:, i] = term = checked(part.label, part.call(true), (n,), np.float64)
            if (large := np.abs(term) > MOST).any():
                raise InvalidInputError(f"{part.label} returned {term[large][0]:g}, expected numbers within ±{MOST:g}")
        codes = np.zeros(n, dtype=np.int64)
        for code, part in enumerate(self._ends, start=1):
            ended = checked(part.label, part.call(true), (n,), np.bool_)
            codes[ended & (codes == 0)] = code
        if self.metrics is not None:
            self.metrics.add(true.numbers, self._measured(true))
        rows = self._observe(seen)
        success = self._success
        won = np.zeros(n, bool) if success is None else checked(success.label, success.call(true), (n,), np.bool_)
        # The task's own termination may be a success; a function that is added to it is a failure.
        return terms, codes, won & (codes <= 1), rows

    def observe(self, *arrays: npt.NDArray[Any]) -> FloatArray:
        """Rows from the true states."""
        return self._observe(self._robots(*arrays)[0])

    def _measured(self, robots: Robots) -> dict[str, FloatArray]:
        """The metrics of a task in this step."""
        assert self._metrics is not None
        of = f"{type(self.task).__name__}.metrics"
        found = self._metrics(robots)
        if not isinstance(found, Mapping) or (self.metrics is not None and set(found) != set(self.metrics.names)):
            names = "" if self.metrics is None else f" with the names {', '.join(self.metrics.names)}"
            raise InvalidInputError(f"{of} returned {_short(found)}, expected a dict of numbers by name{names}")
        return {name: checked(f"{of}.{name}", value, (len(robots),), np.float64) for name, value in found.items()}

    def _observe(self, robots: Robots) -> FloatArray:
        n = len(robots)
        rows = np.empty((n, len(self.rows)))
        first = 0
        for part in self._rows:
            found = checked(part.label, part.call(robots), (n, *part.shape), None)
            rows[:, first : first + part.width] = found.reshape(n, part.width)
            first += part.width
        return rows

    def _robots(
        self,
        truth: npt.NDArray[np.float32],
        observed: npt.NDArray[np.float32],
        commands: FloatArray,
        steps: npt.NDArray[np.int64],
        indices: npt.NDArray[np.intp],
        _: npt.NDArray[np.uint32],
    ) -> tuple[Robots, Robots]:
        rest = (commands, steps, indices, self._control_dt)
        self._present = true = Robots(truth, *rest)
        return true, true if observed is truth else Robots(observed, *rest)

    def _at_rest(self, one: Batch, num_envs: int) -> Robots:
        """Upright robots at rest, without an episode."""
        rows = np.zeros((num_envs, WIDTH), dtype=np.float32)
        rows[:, COLUMNS["gravity"]] = (0.0, 0.0, -1.0)
        rows[:, COLUMNS["body_quaternion"]] = (1.0, 0.0, 0.0, 0.0)
        rows[:, COLUMNS["body_com"]] = one.params(0).body_com
        commands = np.zeros((num_envs, len(one.command(0))))
        return Robots(rows, commands, np.zeros(num_envs, np.int64), np.arange(num_envs), self._control_dt)


def split(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Options for the core, and functions by name for each of `FUNCTION_OPTIONS` that has some.

    Raises:
        TypeError: an option with functions is not a mapping.
    """
    rest, functions = dict(options), {}
    for option in FUNCTION_OPTIONS:
        given = rest.get(option)
        if option != "reward":
            rest.pop(option, None)
            if given is not None and not isinstance(given, Mapping):
                raise TypeError(f"{option} is of type {type(given).__name__}, expected a dict of functions by name")
        if not isinstance(given, Mapping):
            continue
        # Numbers are scales of the terms of the task.
        chosen = {
            of: value for of, value in given.items() if option != "reward" or callable(value) or isinstance(value, str)
        }
        if chosen:
            functions[option] = chosen
        if option == "reward":
            rest[option] = {of: value for of, value in given.items() if of not in chosen}
    return rest, functions


def _function(label: str, given: object) -> tuple[Function, str]:
    """A function, or an object of a class that is callable; with its name."""
    text = given if isinstance(given, str) else None
    if text is not None:
        given = imported(label, text)
    if not callable(given):
        raise TypeError(f"{label} = {given!r}: expected a function of robots, or its name as 'module:function'")
    if text is None:
        text = f"{getattr(given, '__module__', None)}:{getattr(given, '__qualname__', '')}"
        try:
            is_named = imported(label, text) is given
        except InvalidInputError:
            is_named = False
        # A lambda, a method, a wrapper: in a file this gives an error, not another function.
        text = text if is_named else f"{given!r}, which has no name in a module"
    # A class has its own memory in each batch.
    return (given() if isinstance(given, type) else given), text


def imported(label: str, name: str) -> object:
    """The function of a name, as "module:function".

    Raises:
        ValueError: there is none.
    """
    module, _, path = name.partition(":")
    if not (module and path):
        raise InvalidInputError(f"{label} = {name!r}: expected a function of robots, or its name as 'module:function'")
    try:
        found: object = importlib.import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except AttributeError as error:
        if module != "__main__":
            raise InvalidInputError(f"{label} = {name!r} cannot be imported: {error}") from error
        raise InvalidInputError(
            f"{label} = {name!r} is a function of the program that named it, and {path} is not in this program: move "
            f"it to a module, name it as 'my_module:{path}', and import the module first (ballbot "
            "--import my_module COMMAND ...)"
        ) from error
    except (ImportError, ValueError) as error:
        raise InvalidInputError(f"{label} = {name!r} cannot be imported: {error}") from error
    return found


def _rows(part: Part, robots: Robots, *, needs_columns: bool) -> Rows:
    """The function with the shape that its result has."""
    found = real_array(f"{part.label} returned", part.call(robots), "numbers")
    n, is_one = len(robots), found.ndim == 1 and not needs_columns
    if (not is_one and (found.ndim != 2 or found.shape[1] == 0)) or found.shape[0] != n:
        expected = f"({n}, k): one row per robot" if needs_columns else f"({n},) or ({n}, k)"
        raise InvalidInputError(f"{part.label} returned shape {found.shape}, expected {expected}")
    return Rows(part.label, part.call, found.shape[1:])


def _named(task: Task, width: int) -> list[str]:
    """The names of the rows that a task observes."""
    names = list(task.row_names or ())
    if len(names) != width or len(set(names)) != width or not all(isinstance(name, str) for name in names):
        raise InvalidInputError(
            f"row_names of {type(task).__name__} has {names}, expected {width} different names, as observe has columns"
        )
    return names


def _short(found: object) -> str:
    return f"names {', '.join(map(str, found)) or 'none'}" if isinstance(found, Mapping) else type(found).__name__


def _bounds(task: Task, width: int) -> list[float]:
    """Bounds of the rows that a task observes."""
    of = f"observation_bound of {type(task).__name__}"
    given = real_array(f"{of} is", task.observation_bound, "numbers")
    try:
        bounds = np.broadcast_to(given.astype(np.float32), (width,))
    except ValueError:
        raise InvalidInputError(f"{of} has shape {given.shape}, expected () or {(width,)}") from None
    if not (np.isfinite(bounds) & (bounds > 0.0)).all():
        raise InvalidInputError(f"{of} must be finite and above 0")
    found: list[float] = bounds.tolist()
    return found


def checked(label: str, value: npt.ArrayLike, shape: tuple[int, ...], kind: type | None) -> npt.NDArray[Any]:
    """The result of a function, as an array of `kind`; None leaves numbers as they are.

    Raises:
        ValueError: a wrong shape, or numbers that are not finite; the message names the function.
        TypeError: another kind, or a masked array.
    """
    kinds, desired = ("b", "bool") if kind is np.bool_ else ("biuf", "numbers")
    array = real_array(f"{label} returned", value, desired, kinds)
    if array.shape != shape:
        raise InvalidInputError(f"{label} returned shape {array.shape}, expected {shape} for {shape[0]} robots")
    if kind is not np.bool_ and not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InvalidInputError(
            f"{label} returned {array[tuple(bad)]} at {tuple(bad.tolist())}, expected finite numbers"
        )
    return array if kind is None else array.astype(kind, copy=False)
