"""The robot in the browser: a session that simulates, and a page that shows it.

`session` with `robots` (each a `robot` of a `setup`, with `changes` within `bounds`), an `objective` (`balancing`,
maybe along a `route`, or `commanding`, which asks what `asked` has) with its `drivers`, a `player` of a `recording`
with `history`, a `ghost`, `notices`, `trial` and `watch` knows no browser, and `runner` is the thread that owns it.
All others show it with viser, and only they import what `[view]` installs: `page` with `status`, `run_panel`,
`robot_panel`, `tuning`, `plots`, `record_panel` (`download`, `link`), `view_panel` and `command_panel`, made of
`controls`; `scene` with `effects`, `camera`, `handle` and `command_nodes`, made of `shapes`, `arrows` and `urdf`; on
a `server` that `access` and `messages` guard, whose page has what is in `front`, beside which `driving` listens to
keys; `view` puts all together.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
