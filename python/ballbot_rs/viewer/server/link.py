"""A link that restores the present choice: the query of the page's address."""

from typing import Any, Final
from urllib.parse import parse_qsl, urlencode

from ballbot_rs.control.resolve import NAMES
from ballbot_rs.viewer.session.policies import shipped, shipped_name
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.session.setup import CHANGES, NEUTRAL, checked

#: Choices in a link, as parameters of `Session.choose`, in addition to the names of `setup.CHANGES`.
CHOICES: Final = ("robot", "model", "controller", "task", "observation", "num_robots")

#: Longest query that is read.
MAX_QUERY: Final = 1024


def query_of(session: Session) -> str:
    """Query of the present choice. A policy is omitted unless it ships with the package: its file is local."""
    robots = session.robots
    chosen: dict[str, Any] = {"robot": robots.name, "model": robots.model, "task": session.task}
    if session.controller in NAMES:
        chosen["controller"] = session.controller
    elif name := shipped_name(session.controller):
        chosen["policy"] = name
    if session.observation != "ground_truth":
        chosen["observation"] = session.observation
    if len(robots) > 1:
        chosen["num_robots"] = len(robots)
    chosen |= {name: f"{value:g}" for name, value in session.changes.items() if value != NEUTRAL[name]}
    compared = None if session.ghost is None else session.ghost.controller
    if compared is not None and (name := compared if compared in NAMES else shipped_name(compared)):
        chosen["compare"] = name
    if session.speed != 1.0:
        chosen["speed"] = f"{session.speed:g}"
    return urlencode(chosen)


def parts_of(query: str) -> dict[str, str]:
    """Names and values of a query.

    Raises:
        ValueError: it is too long, repeats a name, or has an unknown name or a controller that is not ours.
    """
    if len(query) > MAX_QUERY:
        raise ValueError(f"a link of {len(query)} characters: expected at most {MAX_QUERY}")
    pairs = parse_qsl(query.removeprefix("?"))
    parts = dict(pairs)
    if len(parts) != len(pairs):
        raise ValueError("a link names each choice once")
    for name in parts:
        if name not in (known := (*CHOICES, *CHANGES, "policy", "compare", "speed")):
            raise ValueError(f"a link has no '{name}': expected some of {', '.join(known)}")
    # A path may come from another site.
    policies = tuple(shipped())
    for name, allowed in (("controller", NAMES), ("compare", (*NAMES, *policies)), ("policy", policies)):
        if name in parts and parts[name] not in allowed:
            raise ValueError(f"{name} = '{parts[name]}' in a link: expected one of {', '.join(allowed)}")
    if "policy" in parts and "controller" in parts:
        raise ValueError("a link has a controller or a policy, not both")
    return parts


def restore(session: Session, query: str) -> None:
    """Applies the choices of a link.

    Raises:
        ValueError: as `parts_of`, or the session rejects a choice; earlier choices stay.
    """
    parts = parts_of(query)
    choices: dict[str, Any] = {name: parts[name] for name in CHOICES if name in parts}
    if "policy" in parts:
        choices["controller"] = str(shipped()[parts["policy"]])
    if "num_robots" in choices:
        choices["num_robots"] = int(choices["num_robots"])
    if choices:
        session.choose(**choices)
    changes = {name: float(parts[name]) for name in CHANGES if name in parts}
    session.change(**{**NEUTRAL, **checked(changes)})
    if "compare" in parts:
        compared = parts["compare"]
        session.compare_with(compared if compared in NAMES else str(shipped()[compared]))
    if "speed" in parts:
        session.set_speed(float(parts["speed"]))
