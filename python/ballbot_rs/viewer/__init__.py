"""The robot in the browser: a session that simulates, and a page that shows it.

`session` with `robots` (each a `robot` of a `setup`, with `changes` within `bounds`), `drivers`, `trial`, `watch`,
`recording` and `history` is independent of the browser, and `runner` is the thread that owns it. All others show it
with viser, and only they import what `[view]` installs:
`page` with `scene`, `camera`, `handle`, `tuning` and `plots`, made of `shapes` and `urdf`, on a `server` that `access`
and `messages` guard; `view` puts all together.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
