"""The robot in the browser: a session that simulates, and a page that shows it.

`session` with `robots` (each a `robot` of a `setup`, with `changes` within `bounds`), an `objective` (`balancing`, or
`commanding`, which asks what `asked` has) with its `drivers`, `trial`, `watch`, `recording` and `history` knows no
browser, and `runner` is the thread that owns it. All others show it with viser, and only they import what `[view]`
installs: `page` with `scene`, `camera`, `handle`, `tuning`, `plots`, `command_panel` and `command_nodes`, made of
`shapes`, `arrows` and `urdf`, on a `server` that `access` and `messages` guard, beside which `driving` listens to keys;
`view` puts all together.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
