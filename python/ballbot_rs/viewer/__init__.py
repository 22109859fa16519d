"""The robot in the browser: a session that simulates, and a page that shows it.

`session` does not know the browser, nor do its parts: `robots` (each a `robot` of a `setup`, with `changes` within
`bounds`), an `objective` (`balancing`, optionally along a `route`, or `commanding`, with commands in `asked`) with its
`drivers`, a `player` of a `recording` with `history`, a `ghost`, `notices`, `trial` and `watch`; `runner` is the thread
that owns it. All other modules show it with viser, and only they import what `[view]` installs: `page` with `status`,
`run_panel`, `robot_panel`, `tuning`, `plots`, `record_panel` (`download`, `link`), `view_panel` and `command_panel`,
made of `controls`; `scene` with `effects`, `camera`, `handle` and `command_nodes`, made of `shapes`, `arrows` and
`urdf`; a `server`, guarded by `access` and `messages`, whose page includes `front`; `driving`, which listens to keys;
and `view`, which puts all together.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
