"""A link that restores the present choice: the query of the page's address."""

from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qsl, urlencode

from ballbot_rs import _assets
from ballbot_rs.control.resolve import NAMES
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
    for name, path in _policies().items():
        if Path(session.controller).resolve() == path.resolve():
            chosen["policy"] = name
    if session.observation != "ground_truth":
        chosen["observation"] = session.observation
    if len(robots) > 1:
        chosen["num_robots"] = len(robots)
    chosen |= {name: f"{value:g}" for name, value in session.changes.items() if value != NEUTRAL[name]}
    if session.ghost is not None and session.ghost.controller in NAMES:
        chosen["compare"] = session.ghost.controller
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
    for name in ("controller", "compare"):
        # The path may come from another site.
        if name in parts and parts[name] not in NAMES:
            raise ValueError(f"{name} = '{parts[name]}' in a link: expected one of {', '.join(NAMES)}")
    if "policy" in parts and parts["policy"] not in (policies := _policies()):
        raise ValueError(f"policy = '{parts['policy']}' in a link: expected one of {', '.join(policies)}")
    if "policy" in parts and "controller" in parts:
        raise ValueError("a link has a controller or a policy, not both")
    return parts


def _policies() -> dict[str, Path]:
    """The policies that ship with the package."""
    return {path.stem: path for path in sorted(_assets.path("policies").glob("*.onnx"))}


def restore(session: Session, query: str) -> None:
    """Applies the choices of a link.

    Raises:
        ValueError: as `parts_of`, or the session rejects a choice; earlier choices stay.
    """
    parts = parts_of(query)
    choices: dict[str, Any] = {name: parts[name] for name in CHOICES if name in parts}
    if "policy" in parts:
        choices["controller"] = str(_policies()[parts["policy"]])
    if "num_robots" in choices:
        choices["num_robots"] = int(choices["num_robots"])
    if choices:
        session.choose(**choices)
    changes = {name: float(parts[name]) for name in CHANGES if name in parts}
    session.change(**{**NEUTRAL, **checked(changes)})
    if "compare" in parts:
        session.compare_with(parts["compare"])
    if "speed" in parts:
        session.set_speed(float(parts["speed"]))
