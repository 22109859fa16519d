"""The simulated robots, their controllers and commands, recording and replay; without the browser."""

from ballbot_rs.viewer.session.foreign import is_any_left
from ballbot_rs.viewer.session.opening import open_session
from ballbot_rs.viewer.session.session import MAX_ROBOTS, Session

__all__ = ["MAX_ROBOTS", "Session", "is_any_left", "open_session"]
