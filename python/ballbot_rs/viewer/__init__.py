"""The robot in the browser: a session that simulates, and a page that shows it.

`session` with `controllers`, `policy`, `recording` and `history` knows no browser; `runner` is the thread that owns it;
`page` with `scene`, `plots`, `shapes` and `urdf` shows it with viser. Only the last five import what `[view]` installs.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
