"""Controllers by name, by path or as objects."""

import copy
import dataclasses
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import CONTROLLERS, Controller, Params, State
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs._modules import module_of
from ballbot_rs.control import policy_file
from ballbot_rs.control.laws import Law, Laws, failed, is_batched
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.control.recurrent import Policy
from ballbot_rs.envs._batch_env import decided, without_curriculum
from ballbot_rs.envs.registration import DEFAULT_TASK, name_of, task_of

#: Names of controllers: the core's, and zero torque. Anything else is the path of a policy.
NAMES: Final = (*CONTROLLERS, "zero")

#: The law of one motion, which `simulate` plans along its reference; other functions take the law that
#: `OptimizedTrajectory.law()` makes.
PLANNED: Final = "tvlqr"

#: Time between two calls of a controller that has none, s.
CONTROL_DT: Final = 0.01

#: Events of the environment that a policy was trained in, in place of the name of a set.
TRAINED: Final = "trained"

#: Largest file that is read from an untrusted source; exported policies have some 30 kB.
MAX_FILE_SIZE: Final = 64 * 2**20

#: A name, a path, a law or a class of laws in Python (`laws` has their forms), or the result of `find` for one of them.
Source: TypeAlias = "str | PathLike[str] | Law | Callable[..., Law] | ResolvedController"


@dataclasses.dataclass(frozen=True)
class ResolvedController:
    """A controller that is not on any robot yet: either a policy or a feedback law."""

    name: str
    #: Options of the environment that a policy was trained in, without its events; for a feedback law, the options that
    #: it is made for, or of the policy that it is compared with.
    env_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    policy: Policy | None = None
    #: The task that a policy was trained in; laws have none.
    task: str | None = None
    #: Makes the law of one robot from its parameters and the time between two calls, s.
    make_law: Callable[[Params, float], Law] | None = None
    #: The law that `make_law` resets and returns; None: each call makes another law.
    existing: Law | None = None
    #: Control period of the law, s; None takes the task's.
    control_dt: float | None = None
    #: Options of a law of the core that are not its defaults.
    law_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: Ends a call of the policy in another thread, where that is possible.
    interrupt: Callable[[], None] | None = None
    #: Longest time of a call, s; None is the limit for any controller, where there is one.
    max_call: float | None = None
    #: Events of the environment that a policy was trained in; evaluation uses nominal robots unless they are requested.
    events: Sequence[Mapping[str, Any]] = ()

    @property
    def is_planned(self) -> bool:
        """Whether it is `PLANNED`, for which a motion has to be planned."""
        return self.make_law is _without_motion

    def law(self, params: Params, control_dt: float) -> Law:
        """The feedback law; a law of the core runs all robots of a batch."""
        assert self.make_law is not None
        return self.make_law(params, control_dt)

    def copied(self) -> "ResolvedController":
        """The controller for other robots at the same time, as `copy.deepcopy` copies its object.

        Raises:
            TypeError: an object that cannot be copied.
        """
        if self.existing is None:
            return self
        try:
            law = copy.deepcopy(self.existing)
        except Exception as error:
            raise TypeError(f"{self.name} cannot be copied: {error}") from error
        found = _from_object(law, self.name)
        return dataclasses.replace(self, make_law=found.make_law, existing=law)

    def laws(self, count: int, params: Params, control_dt: float) -> Laws:
        """The feedback law on each of `count` robots, within the torque of their motors.

        Raises:
            TypeError: an object that cannot be copied, for more than one robot.
            ControllerError: a law in Python cannot be made.
        """
        limit = params.max_wheel_torque
        return Laws(self.name, lambda: self.law(params, control_dt), count, limit, is_made=self.existing is None)


@runtime_checkable
class Resolvable(Protocol):
    """A law that needs more than its call and its attributes."""

    def resolved(self) -> ResolvedController:
        """The law as `find` returns it."""


#: Makers of laws from an address, by its scheme.
SCHEMES: Final[dict[str, Callable[[str], Resolvable]]] = {}


def find(
    source: Source,
    *,
    task: str | None = None,
    env_options: Mapping[str, Any] | None = None,
    trusted: bool = True,
) -> ResolvedController:
    """A controller from its name, from the path of a policy (Stable-Baselines3, ONNX or a training run) or an object.

    Args:
        source: one of `NAMES`, `PLANNED`, the path of a policy, the address of a `Link`, "file.py:NAME" (a function, an
            object or a class), or such a function, object or class. They are called with a `State`, or a `State` and a
            `Setpoint`, and return three wheel torques in N·m; `ballbot_rs.control.laws` has all forms. Classes are
            instantiated for each robot, with the robot as `robot` and the time between two calls as `control_dt` if
            they take them. Attributes `name` and `control_dt` (s) and the method `reset` are optional, and so is
            `env_options` of an object, the options of the environment that it is made for.
        task: the task; None is the task that a policy file names. A file that does not name its task needs `task` or
            `env_options`. In another task an ONNX policy follows the setpoints, as `OnnxPolicy.controller`.
        env_options: options of the environment that such a policy file was trained with.
        trusted: whether files with code may be loaded; ONNX files have none.

    Raises:
        ValueError: an unknown task or controller, or a policy for another task.
        FileNotFoundError: there is no policy at that path.
        ModuleNotFoundError: an optional dependency is missing; the message states what to install.
        TypeError: the object cannot be called, or a class needs other arguments.
        ControllerError: a class cannot be instantiated.
    """
    if task is not None:
        task = name_of(task)
    if isinstance(source, ResolvedController):
        return source
    if isinstance(source, str) and trusted and (scheme := source.partition(":")[0]) in SCHEMES:
        return SCHEMES[scheme](source).resolved()
    if not isinstance(source, (str, PathLike)):
        return _from_object(source)
    name = fspath(source)
    if name in CONTROLLERS:
        return ResolvedController(
            name,
            make_law=lambda params, control_dt: Controller(name, params, control_dt),
            control_dt=CONTROLLERS[name]["control_dt"],
        )
    if name in NAMES:
        return ResolvedController(name, make_law=lambda params, control_dt: _no_torque)  # noqa: ARG005
    if name == PLANNED:
        return ResolvedController(name, make_law=_without_motion)
    path = policy_file.in_run(Path(name))
    if path.suffix == ".onnx":
        if not trusted:
            _check_size(path)
        onnx = OnnxPolicy(path)
        if task not in (None, onnx.task):
            try:
                own_dt = onnx.controller().control_dt
            except ValueError:
                # A policy that follows no setpoints is for another environment, which this error names.
                OnnxPolicy(path, task)
                raise
            return ResolvedController(name, make_law=lambda params, _: onnx.controller(params), control_dt=own_dt)
        options, events = _without_events(onnx.env_options)
        policy: Policy = onnx if onnx.state_len else onnx.act
        return ResolvedController(name, options, policy, onnx.task, interrupt=onnx.interrupt, events=events)
    if not trusted:
        raise ValueError(
            f"unknown controller '{name}': expected {', '.join(NAMES)} or a policy file that ends in .onnx"
        )
    file, _, attribute = name.rpartition(":")
    if file.endswith(".py") and attribute:
        return _from_object(_load_object(Path(file), attribute), name)
    if not path.exists() and path.suffix not in (".zip", ".py:"):
        known = f"expected {', '.join(NAMES)} or the path of a policy"
        raise FileNotFoundError(f"no policy at {name}: {known}{did_you_mean(name, NAMES)}")
    if path.suffix in (".py", ".py:"):
        raise ValueError(f"{name} is not a policy file: a law in Python is named by FILE.py:NAME")
    with require("a policy file", "train"):
        from ballbot_rs.control import sb3_policy, sb3_recurrent
    given = None if task is None and not env_options else _without_events(env_options or {})[0]
    model, found = sb3_policy.load(path, task, given)
    options, events = _without_events(found["env_options"])
    own_task = task_of(found["env_id"])
    own = sb3_recurrent.of(model) or (lambda observations: sb3_policy.act(model, observations))
    return ResolvedController(name, options, own, own_task, events=events)


def _without_motion(_params: Params, _control_dt: float) -> Law:
    raise InvalidInputError(
        f"{PLANNED} follows one motion, so it has to be planned: use it in `simulate` with a Reference or a position, "
        "or use the law of a motion, optimize_trajectory(...).law()"
    )


def _without_events(options: Mapping[str, Any]) -> tuple[dict[str, Any], Any]:
    without: dict[str, Any] = {"events": []} if "events" in options else {}
    return {**options, **without}, options.get("events") or ()


def _check_size(path: Path) -> None:
    if path.is_file() and path.stat().st_size > MAX_FILE_SIZE:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, more than {MAX_FILE_SIZE}: too large for a policy")


def common_task(controllers: Sequence[ResolvedController], task: str | None = None) -> str:
    """The requested task, else the task of the policies among the controllers, else balancing.

    Raises:
        ValueError: a policy for another task, or policies for different tasks.
    """
    policies = [controller for controller in controllers if controller.task is not None]
    task = None if task is None else name_of(task)
    chosen = task or (policies[0].task if policies else None) or DEFAULT_TASK
    for controller in policies:
        if controller.task != chosen:
            other = f"the task {chosen}" if task is not None else f"the task of {policies[0].name}, {chosen}"
            raise ValueError(f"{controller.name} was trained for the task {controller.task}, not for {other}")
    return chosen


def common_options(
    controllers: Sequence[ResolvedController], env_options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The options of the environment that the policies among the controllers share, updated by `env_options`.

    Events come only from `env_options`; `TRAINED` there selects the events that the policies were trained with.

    Raises:
        ValueError: policies that were trained with different options, or, with `TRAINED`, different events or none.
    """
    policies = [controller for controller in controllers if controller.policy is not None or controller.env_options]
    options: Mapping[str, Any] = policies[0].env_options if policies else {}
    for controller in policies:
        if controller.env_options != options or _row_names(controller.env_options) != _row_names(options):
            raise ValueError(
                f"{controller.name} is for {dict(controller.env_options)}, {policies[0].name} for {dict(options)}: "
                "not the same task"
            )
    given = decided(env_options or {})
    if isinstance(given.get("events"), str) and given["events"] == TRAINED:
        found = [controller.events for controller in policies]
        if not found or any(events != found[0] for events in found):
            raise ValueError(f"events = '{TRAINED}': the controllers have no policy, or policies with different events")
        given["events"] = found[0]
    return {**without_curriculum(options), **given}


def _row_names(options: Mapping[str, Any]) -> list[str]:
    """Names of added rows in the order in which they are observed."""
    return list(options.get("rows") or ())


def options_of(
    controller: ResolvedController, shared: Mapping[str, Any], env_options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The shared options for a controller: the torque of a policy's action does not limit a feedback law."""
    is_kept = controller.policy is not None or "max_wheel_torque" in (env_options or {})
    return {name: value for name, value in shared.items() if is_kept or name != "max_wheel_torque"}


def _load_object(file: Path, attribute: str) -> Any:
    """An object in a Python file, or an instance of a class in it."""
    module = module_of(file)
    if not hasattr(module, attribute):
        raise ValueError(f"{file} has no {attribute}{did_you_mean(attribute, vars(module))}")
    return getattr(module, attribute)


def _from_object(law: Any, name: str | None = None) -> ResolvedController:
    if isinstance(law, type):
        return _from_class(law, name)
    if isinstance(law, Resolvable):
        found = law.resolved()
        return found if name is None else dataclasses.replace(found, name=name)
    if not callable(law):
        raise TypeError(f"{law!r} is not a controller: expected a name, a path, or a map from a state to torques")
    own = getattr(law, "name", None) or getattr(law, "__name__", None) or type(law).__name__.lower()
    name = str(own) if name is None else name

    def fresh(params: Params, control_dt: float) -> Law:  # noqa: ARG001
        # A batched law is given the number of robots; see `Laws`.
        if hasattr(law, "reset") and not is_batched(law):
            try:
                law.reset()
            except Exception as error:
                raise failed(name, error) from error
        same: Law = law
        return same

    options = getattr(law, "env_options", None)
    options = options if isinstance(options, Mapping) else {}
    return ResolvedController(name, options, make_law=fresh, existing=law, control_dt=_control_dt(name, law))


def _from_class(cls: type, name: str | None) -> ResolvedController:
    """A class of laws, instantiated for each robot."""
    own = getattr(cls, "name", None)
    name = (own if isinstance(own, str) else cls.__name__.lower()) if name is None else name
    if not any("__call__" in vars(base) for base in cls.__mro__):
        raise TypeError(f"{name} is not a class of controllers: its objects cannot be called")
    parameters = inspect.signature(cls).parameters.values()
    named = {p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)}
    takes = named & {"robot", "control_dt"}
    needed = [p.name for p in parameters if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    # The earlier name: with a default it would silently get no robot.
    if "params" in named and "robot" not in named:
        raise TypeError(f"{name} takes params: it is now robot")
    if set(needed) - takes:
        missing = ", ".join(part for part in needed if part not in takes)
        raise TypeError(f"{name} cannot be made: {missing} has no default; a class is given only robot and control_dt")

    def make(params: Params, control_dt: float) -> Law:
        given = {"robot": params, "control_dt": control_dt}
        try:
            law: Law = cls(**{part: given[part] for part in given if part in takes})
        except Exception as error:
            raise failed(name, error) from error
        return law

    # Objects made without arguments may have the rate in an attribute.
    if takes or isinstance(getattr(cls, "control_dt", None), (int, float)):
        return ResolvedController(name, make_law=make, control_dt=_control_dt(name, cls))
    try:
        first = cls()
    except Exception as error:
        raise failed(name, error) from error
    return ResolvedController(name, make_law=make, control_dt=_control_dt(name, first))


def _control_dt(name: str, law: Any) -> float | None:
    """A law's own time between two calls."""
    found = getattr(law, "control_dt", None)
    if found is None or (isinstance(law, type) and not isinstance(found, (int, float))):
        return None
    try:
        seconds = float(found)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} has control_dt = {found!r}: expected a time in s") from error
    if not 0.0 < seconds < math.inf:
        raise InvalidInputError(f"{name} has control_dt = {found}: it must be positive and finite")
    return seconds


def _no_torque(state: State) -> npt.ArrayLike:  # noqa: ARG001
    return np.zeros(3)
