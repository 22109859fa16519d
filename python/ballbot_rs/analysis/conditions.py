"""The conditions of a comparison in words: where its environment differs from the task's defaults."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ballbot_rs._core import ROBOTS, SENSORS, Params, load_sensors
from ballbot_rs._robot import params_of
from ballbot_rs.envs._batch_env import new_batch, resolved_options
from ballbot_rs.envs.family import are_several, is_family
from ballbot_rs.envs.registration import description_of

#: Number of a changed robot's parameters that are listed.
_MOST_LISTED = 4


def differences(task: str, options: Mapping[str, Any]) -> list[str]:
    """Robot, motors, events and other options that are not the task's defaults, each as text.

    Args:
        task: name of the task.
        options: options of the environment. `control_dt` is omitted: each controller has its own rate.
    """
    found = []
    if "robot" in options:
        robot = _robot(options["robot"])
        found += [] if robot == "robot paper" else [robot]
    actuators = options.get("actuators")
    if actuators not in (None, {}, "ideal"):
        found.append(f"actuators {_of(actuators)}")
    events = options.get("events")
    if events:
        found.append(f"events {events}" if isinstance(events, str) else f"{len(events)} events of a list or file")
    defaults = _resolved(task, {name: options[name] for name in ("robot", "actuators") if name in options})
    resolved = _resolved(task, options)
    apart = ("model", "robot", "actuators", "events", "control_dt")
    for name in sorted(options.keys() - apart):
        # None of an option means its default.
        if options[name] is not None and not _equal(resolved.get(name), defaults.get(name)):
            found.append(f"{name} = {_of(_sensors(options[name]) if name == 'sensors' else options[name])}")
    return found


def baselines(task: str) -> tuple[str, ...]:
    """Controllers that can perform the task, with which a policy is compared."""
    return ("lqr",) if description_of(task)["command"] else ("lqr", "pid")


def success_rule(task: str, options: Mapping[str, Any]) -> str:
    """The condition for an episode to count as a success; empty for a task without successes."""
    resolved = _resolved(task, options)
    try:
        window, tilt, radius = (resolved[f"success_{name}"] for name in ("window", "tilt", "radius"))
    except KeyError:
        rule = description_of(task)["success"]
        return f"Success: {rule}." if rule else ""
    return (
        f"Success: upright, and over the last {window:g} s tilt within {math.degrees(tilt):.3g} deg and ball within "
        f"{radius:g} m of the setpoint."
    )


def _resolved(task: str, options: Mapping[str, Any]) -> dict[str, Any]:
    return resolved_options(new_batch(1, task=task, num_threads=1, options=options), {})


def _equal(a: Any, b: Any) -> bool:
    if any(value is None or isinstance(value, (str, Mapping)) for value in (a, b)):
        return bool(a == b)
    return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=1e-9, atol=0.0)


def _of(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} = {_of(v)}" for name, v in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _sensors(given: Any) -> Any:
    """The name of sensors, if they have one."""
    return next((name for name in SENSORS if given == load_sensors(name)), given)


def _robot(given: Any) -> str:
    if is_family(given):
        other = " with other ranges" if given.get("ranges") else ""
        return f"eight episodes for each of {given['family']} robots of the family{other}, seed {given.get('seed', 0)}"
    if are_several(given):
        return f"{len(given)} robots"
    if not isinstance(given, (Params, Mapping)):
        return f"robot {given}"
    own = params_of(given).to_dict()
    changed = {name: _changes(own, Params.preset(name).to_dict()) for name in ROBOTS}
    nearest = min(changed, key=lambda name: len(changed[name]))
    if len(changed[nearest]) > _MOST_LISTED:
        return "a robot from a file"
    return " with ".join(filter(None, (f"robot {nearest}", ", ".join(changed[nearest]))))


def _changes(own: Mapping[str, Any], preset: Mapping[str, Any]) -> list[str]:
    return [f"{name} = {_of(value)}" for name, value in own.items() if value != preset[name]]
