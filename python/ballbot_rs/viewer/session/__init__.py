"""The simulated robots, their controllers and commands, recording and replay; without the browser."""

from ballbot_rs.viewer.session.foreign import is_any_left
from ballbot_rs.viewer.session.session import MAX_ROBOTS, Session
from ballbot_rs.viewer.session.setup import DECIDED

__all__ = ["DECIDED", "MAX_ROBOTS", "Session", "is_any_left"]
