"""Tasks in Python by their ids."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from ballbot_rs._core import TASKS, Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.envs.own.metrics import SUMMARIES
from ballbot_rs.envs.own.task import NO_TIME_LIMIT, Task


@dataclasses.dataclass(frozen=True)
class Registered:
    """A task in Python with the default options of its environments."""

    made_by: type[Task]
    #: Given at its registration.
    options: Mapping[str, Any]
    #: As for tasks of the core in `TASKS`.
    description: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def parameters(self) -> tuple[str, ...]:
        """Names of the arguments of its constructor."""
        given = inspect.signature(self.made_by).parameters.values()
        return tuple(p.name for p in given if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY))


#: Arguments of the front ends, of `gymnasium.make` and of `register`, which no task can have.
TAKEN: Final = (
    *("num_envs", "task", "env_id", "autoreset_mode", "num_threads", "seed", "stagger", "torch_threads"),
    *("render_mode", "width", "height", "camera", "render_options"),
    *("id", "disable_env_checker", "vectorization_mode", "vector_kwargs", "wrappers"),
)

#: What a task without a base has.
_WITHOUT_BASE: Final[Mapping[str, Any]] = {
    "options": [],
    "observation": [],
    "rewards": [],
    "command": [],
    "geometry": None,
    "metrics": [],
    "has_terrain": False,
}

_REGISTERED: Final[dict[str, Registered]] = {}


def add(
    env_id: str,
    made_by: type[Task],
    options: Mapping[str, Any],
    options_of: Callable[[str | None], Sequence[str]],
    make: Callable[[], Batch],
) -> None:
    """Makes a task known by an id; `make` then makes one robot with it, and `options_of` has the options of a base.

    Raises:
        TypeError: it is not a subclass of `Task`, or its `units` or `summaries` are not a dict.
        ValueError: the id belongs to a task of the core, an argument of the constructor has the name of an option of
            environments, or `units` or `summaries` do not fit the metrics.
    """
    if not (isinstance(made_by, type) and issubclass(made_by, Task)):
        raise TypeError(f"register takes a subclass of Task, not {made_by!r}")
    if made_by.base is not None and made_by.base not in TASKS:
        raise InvalidInputError(
            f"base = {made_by.base!r} of {made_by.__name__} is not a task of the core: expected one of "
            f"{', '.join(TASKS)}, or None"
        )
    if any(env_id in (name, task["id"]) for name, task in TASKS.items()):
        raise InvalidInputError(
            f"'{env_id}' is a task of ballbot_rs: choose another id, as \"me/{made_by.__name__}-v0\""
        )
    found = Registered(made_by, dict(options))
    for name in found.parameters():
        if name in options_of(made_by.base) or name in TAKEN:
            raise InvalidInputError(
                f"{made_by.__name__} has an argument '{name}', which is an option of every environment: give it "
                "another name (a task reads the duration of a control step from robots.control_dt)"
            )
    _REGISTERED[env_id] = found
    _REGISTERED[env_id] = dataclasses.replace(found, description=_describe(found, env_id, make()))


def _describe(found: Registered, env_id: str, batch: Batch) -> dict[str, Any]:
    stage = batch.stage
    assert stage is not None
    base = TASKS[found.made_by.base] if found.made_by.base is not None else _WITHOUT_BASE
    rows = [
        {"name": name, "unit": unit, "bound": bound, "rest": 0.0, "typical": typical}
        for name, unit, bound, typical in stage.rows
    ]
    units, kinds = found.made_by.units, () if stage.metrics is None else stage.metrics.kinds
    own = [
        {"name": name, "unit": units.get(name, ""), "doc": SUMMARIES[kind]}
        for name, kind in zip(stage.metric_names, kinds, strict=True)
    ]
    if taken := {metric["name"] for metric in base["metrics"]} & set(stage.metric_names):
        raise InvalidInputError(
            f"{found.made_by.__name__}.metrics has '{min(taken)}', which its base {found.made_by.base} has already"
        )
    own_success = stage.decides_success or found.made_by.base is None
    # Not an inherited docstring: the base class describes tasks in general.
    summary = next(iter((found.made_by.__doc__ or "").strip().splitlines()), found.made_by.__name__)
    return {
        **base,
        "id": env_id,
        "summary": summary,
        "success": "the method `success` of the task returns True" if own_success else base["success"],
        "max_episode_steps": None if batch.max_episode_steps == NO_TIME_LIMIT else batch.max_episode_steps,
        "reward_threshold": None,
        "observation": [*base["observation"], *rows],
        "rewards": [
            *({**term, "scale": 0.0} for term in base["rewards"]),
            {"name": "reward", "scale": 1.0, "cost": False, "formula": "computed by the task"},
        ],
        "terminations": batch.terminations,
        "metrics": [*base["metrics"], *own],
    }


def restore(env_id: str, before: Registered | None) -> None:
    """Restores the former meaning of an id."""
    _REGISTERED.pop(env_id, None)
    if before is not None:
        _REGISTERED[env_id] = before


def description_of(env_id: str) -> Mapping[str, Any]:
    """Description as in `TASKS` for tasks of the core."""
    return _REGISTERED[env_id].description


def find(task: str) -> Registered | None:
    """The task of an id, if it is a task in Python."""
    return _REGISTERED.get(task)


def ids() -> tuple[str, ...]:
    """Ids of the tasks in Python."""
    return tuple(_REGISTERED)
