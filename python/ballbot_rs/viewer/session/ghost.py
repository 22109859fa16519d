"""A second session next to the first: the same robot under another controller, with the same inputs."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

from ballbot_rs._state_rows import tilt_components_of
from ballbot_rs.viewer.session.recording import Ghost

if TYPE_CHECKING:
    from ballbot_rs.viewer.session.session import Session

P = ParamSpec("P")


def label_of(controller: str) -> str:
    """Name of a controller as shown: of a policy's file without folder and suffix."""
    return Path(controller).stem if controller.endswith(".onnx") else controller


def ghost_of(session: "Session") -> Ghost:
    """Robot 0 of a session as a ghost of another."""
    state = session.robots.states[0].to_array()
    tilt = tilt_components_of(state, session.robots[0].params.body_com)
    return Ghost(label_of(session.controller), state, tilt)


def shared(method: Callable[Concatenate[Any, P], None]) -> Callable[Concatenate[Any, P], None]:
    """A method of a session that is also called on its ghost. Errors of the ghost are not errors of the session."""

    @functools.wraps(method)
    def both(session: Any, /, *arguments: P.args, **named: P.kwargs) -> None:
        method(session, *arguments, **named)
        if session.ghost is not None:
            _try(session, functools.partial(method, session.ghost, *arguments, **named))

    return both


def keep_up(session: "Session") -> None:
    """Advances a session's ghost to the same time and episode: if only the ghost falls, it restarts the episode."""
    ghost = session.ghost
    if ghost is None:
        return
    ghost.robots.restart_episodes = session.robots.episodes[:1]
    try:
        if ghost.robots.episodes[0] < session.robots.episodes[0]:
            ghost.restart([0])
            ghost.time = session.time
        while ghost.time < session.time - 1e-9:
            ghost.step()
    except Exception as error:
        # Its policy may return nonsense; the session continues without it.
        session.ghost = None
        session.notices.append(f"the comparison with {ghost.controller} ended: {error or type(error).__name__}")


def _try(session: "Session", call: Callable[[], Any]) -> None:
    try:
        call()
    except Exception as error:
        # A foreign controller may fail in any way.
        assert session.ghost is not None
        session.notices.append(f"comparison with {session.ghost.controller}: {error or type(error).__name__}")
