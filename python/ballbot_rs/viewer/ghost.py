"""A second session beside the first one: the same robot under another controller, to which the same is done."""

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

if TYPE_CHECKING:
    from ballbot_rs.viewer.session import Session

P = ParamSpec("P")


def shared(method: Callable[Concatenate[Any, P], None]) -> Callable[Concatenate[Any, P], None]:
    """A method of a session that is called of its ghost, too. What the ghost cannot do is no error of the session."""

    @functools.wraps(method)
    def both(session: Any, /, *arguments: P.args, **named: P.kwargs) -> None:
        method(session, *arguments, **named)
        if session.ghost is not None:
            _try(session, functools.partial(method, session.ghost, *arguments, **named))

    return both


def keep_up(session: "Session") -> None:
    """Lets the ghost of a session get to the same time, in the same episode: one that falls alone begins it again."""
    ghost = session.ghost
    if ghost is None:
        return
    ghost.robots.anew_in = session.robots.episodes[:1]
    try:
        if ghost.robots.episodes[0] < session.robots.episodes[0]:
            ghost.start_anew([0])
            ghost.time = session.time
        while ghost.time < session.time - 1e-9:
            ghost.step()
    except Exception as error:
        # Its policy may choose nonsense; the session goes on without it.
        session.ghost = None
        session.notices.append(f"{ghost.controller}, to compare with: {error or type(error).__name__}; it is gone")


def _try(session: "Session", call: Callable[[], Any]) -> None:
    try:
        call()
    except Exception as error:
        # A controller of others may fail in any way.
        assert session.ghost is not None
        session.notices.append(f"{session.ghost.controller}, to compare with: {error or type(error).__name__}")
