"""What a keyword or an option does: whether another value changes the result, or is rejected by name."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import ballbot_rs as bb

PAPER = bb.Params.paper()
START = bb.State.at_rest(PAPER, tilt=(0.06, -0.03), yaw=0.4)


class With:
    """A value of a keyword that acts together with others, which are the same with and without it."""

    def __init__(self, value: Any, **others: Any) -> None:
        self.value, self.others = value, others


@dataclasses.dataclass(frozen=True)
class Refused:
    """A value that is rejected by name."""

    value: Any


@dataclasses.dataclass(frozen=True)
class Same:
    """A value that must not change the result."""

    value: Any


def fingerprint(value: Any) -> Any:
    """A value that is equal only for equal results."""
    if isinstance(value, np.ndarray):
        return (value.shape, str(value.dtype), value.tobytes())
    if isinstance(value, Mapping):
        return tuple((key, fingerprint(part)) for key, part in value.items())
    if isinstance(value, (list, tuple)):
        return tuple(fingerprint(part) for part in value)
    if isinstance(value, bb.State):
        return fingerprint(value.to_array())
    if isinstance(value, bb.Params):
        return fingerprint(value.to_dict())
    if isinstance(value, bb.Terrain):
        x, y = np.meshgrid(np.linspace(-3.9, 3.9, 60), np.linspace(-3.8, 3.8, 61))
        return fingerprint([value.height(x, y), value.size, value.obstacles])
    if isinstance(value, bb.Reference):
        return fingerprint([value.sample(np.linspace(0.0, 9.0, 50)), value.demand])
    if isinstance(value, bb.Controller):
        setpoint = bb.Setpoint(position=(0.1, 0.2), yaw=0.1)
        parts = {name: setpoint[name] for name in value.setpoint_parts if name in setpoint}
        states = [START, bb.State.at_rest(PAPER, tilt=(0.3, 0.2)), bb.State.rolling(PAPER, (0.2, 0.1))]
        return fingerprint(
            [value.control_dt, [np.asarray(value(state, **parts)) for state in states for _ in range(3)]]
        )
    if dataclasses.is_dataclass(value):
        return fingerprint({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    return repr(value)


#: Results without a keyword, with what they follow from: many keywords share them.
_FOUND: dict[tuple[int, int], tuple[Any, Any, Any]] = {}


def _without(call: Callable[..., Any], base: Mapping[str, Any], others: Mapping[str, Any]) -> Any:
    if others:
        return fingerprint(call(**{**base, **others}))
    key = id(call), id(base)
    if key not in _FOUND:
        _FOUND[key] = call, base, fingerprint(call(**base))
    return _FOUND[key][2]


def changes(
    call: Callable[..., Any], name: str, candidates: list[Any], base: Mapping[str, Any], named: str | None = None
) -> str | None:
    """What is wrong with a keyword: None if one of the candidates changes the result, or all are rejected by name.

    `named` is the name in the error, if it is another name.
    """
    rejected = 0
    for candidate in candidates:
        added = candidate.others if isinstance(candidate, With) else {}
        others = {**base, **added}
        value = _value(candidate)
        try:
            before = _without(call, base, added)
        except ValueError as error:
            # What a keyword permits is rejected without it.
            if name not in str(error):
                raise
            before = None
        try:
            after = fingerprint(call(**{**others, name: value}))
        except (ValueError, TypeError) as error:
            if (named or name) not in str(error):
                return f"{name} = {value!r} is rejected without its name: {error}"
            rejected += 1
            continue
        if isinstance(candidate, Refused):
            return f"{name} = {value!r} is not rejected"
        if isinstance(candidate, Same):
            return None if before == after else f"{name} = {value!r} changes the result"
        if before != after:
            return None
    if rejected == len(candidates):
        return None
    return f"{name} changes nothing, tried {[_value(candidate) for candidate in candidates]}"


def _value(candidate: Any) -> Any:
    return candidate.value if isinstance(candidate, (With, Refused, Same)) else candidate
