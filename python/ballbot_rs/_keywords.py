"""Unknown keywords: an error names the nearest, the new name of an old one, and where else it exists."""

import functools
import inspect
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeVar

from ballbot_rs._checks import did_you_mean

F = TypeVar("F", bound=Callable[..., Any])

#: Names of 0.3.0 and what to write in their place.
RENAMED: Final = {
    "params": "robot=",
    "env_options": "its entries as keywords, as control_dt=0.005",
    "controller_params": "controller_robot=",
    "push": "pushes=",
    "scenario": "scenarios=",
}

#: What may be meant by keywords of other libraries.
_MEANT: Final = {
    "dt": ("control_dt", "sim_dt"),
    "timestep": ("control_dt", "sim_dt"),
    "duration": ("seconds", "max_episode_steps"),
    "steps": ("seconds", "max_episode_steps"),
    "num_envs": ("num_robots",),
    "starts": ("start", "tilt"),
    "motors": ("actuators",),
}

#: Most places that are named.
_PLACES: Final = 3


class UnknownKeywordError(TypeError):
    """A keyword that a call does not have; `name` is the keyword, `known` are those that it has."""

    name = ""
    known: Sequence[str] = ()


def unknown(who: str, name: str, known: Sequence[str], hint: str = "") -> UnknownKeywordError:
    """The error about a keyword.

    Args:
        who: what was called.
        name: the keyword.
        known: keywords of the call.
        hint: takes the place of what is nearest.
    """
    hint = hint or renamed(name, known) or _meant(name, known)
    elsewhere = "" if hint else _elsewhere(name, who)
    hint = hint or did_you_mean(name, known)
    if not hint and not elsewhere:
        hint = f": expected one of {', '.join(known)}"
    # TorchRL searches the message for these words.
    error = UnknownKeywordError(f"{who} got an unexpected keyword argument '{name}'{hint}{elsewhere}")
    error.name, error.known = name, tuple(known)
    return error


def of_extension(who: str, name: str, more: Sequence[str]) -> UnknownKeywordError:
    """The error about a keyword of a class or function in Rust, called by the extension module.

    Args:
        who: what was called, as `State.at_rest`.
        name: the keyword.
        more: keywords that the signature does not list.
    """
    from ballbot_rs import _core

    parameters = inspect.signature(operator.attrgetter(who)(_core)).parameters.values()
    return unknown(who, name, (*(p.name for p in parameters if p.kind is not p.VAR_KEYWORD), *more))


def renamed(name: str, known: Sequence[str]) -> str:
    """The new name of an old one, where it is known, as the end of a message; else an empty text."""
    new = RENAMED.get(name, "")
    if not new.endswith("="):
        return f": write {new}" if new else ""
    # What is new in one call is in another what it always was.
    return f": it is now {new}" if new[:-1] in known else ""


def _meant(name: str, known: Sequence[str]) -> str:
    """The keyword that has what a name of another library, of a motor or of a robot means, or an empty text."""
    from ballbot_rs._core import ACTUATOR_OPTIONS, PARAMETERS

    if meant := [one for one in _MEANT.get(name, ()) if one in known]:
        return f": write {' or '.join(f'{one}=' for one in meant)}"
    if "actuators" in known and any(name == option["name"] for option in ACTUATOR_OPTIONS):
        return f": write actuators={{'{name}': ...}}"
    if "robot" in known and any(name == parameter["name"] for parameter in PARAMETERS):
        return f": it is a parameter of robot, as in Params.preset('paper').replace({name}=...)"
    return ""


def check_keywords(
    who: str, given: Iterable[str], known: Sequence[str], hint: Callable[[str], str] | None = None
) -> None:
    """Checks names of keywords.

    Raises:
        TypeError: a name is unknown.
    """
    for name in given:
        if name not in known:
            raise unknown(who, name, known, hint(name) if hint else "")


def named(thing: F) -> F:
    """A function, or a class, whose errors about unknown keywords are ours.

    An unknown option, which something that it calls has found, is reported in its name and with its keywords.
    """
    if isinstance(thing, type):
        thing.__init__ = _checked(thing.__init__, thing.__name__)  # type: ignore[misc]
        return thing
    return _checked(thing, thing.__qualname__)


def _checked(function: F, who: str) -> F:
    parameters = inspect.signature(function).parameters.values()
    known = tuple(
        p.name
        for p in parameters
        if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name not in ("self", "cls")
    )
    has_options = any(p.kind is p.VAR_KEYWORD for p in parameters)

    @functools.wraps(function)
    def call(*args: Any, **keywords: Any) -> Any:
        if not has_options:
            check_keywords(who, keywords, known)
        try:
            return function(*args, **keywords)
        except UnknownKeywordError as error:
            if not has_options or error.name not in keywords:
                raise
            raise unknown(who, error.name, tuple(dict.fromkeys((*known, *error.known)))) from None

    return call  # type: ignore[return-value]


def _elsewhere(name: str, who: str) -> str:
    """Which tasks or public names have a keyword."""
    from ballbot_rs import __all__ as public
    from ballbot_rs.envs._batch_env import option_names
    from ballbot_rs.envs.registration import known_tasks

    tasks = [task for task in known_tasks() if name in option_names(task)]
    if 0 < len(tasks) < len(known_tasks()):
        return f"; '{name}' is an option of the task {_several(tasks)}"
    if tasks:
        return f"; '{name}' is an option of environments, as BallbotEnv, compare, rollout and simulate take it"
    found = [one for one in public if one != who and name in _keywords(one)]
    return f"; '{name}' is a keyword of {_several(found)}" if found else ""


def _several(names: Sequence[str]) -> str:
    more = [f"{len(names) - _PLACES} more"] if len(names) > _PLACES else []
    *others, last = [*names[:_PLACES], *more]
    return f"{', '.join(others)} and {last}" if others else last


def _keywords(public: str) -> Sequence[str]:
    import ballbot_rs

    # Not what is loaded at its first use: it may need an extra.
    thing = vars(ballbot_rs).get(public)
    # Most classes are results: their keywords are columns.
    if not inspect.isfunction(thing):
        return ()
    parameters = inspect.signature(thing).parameters.values()
    return [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
