"""The robot in the browser.

`session` simulates robots and does not depend on the browser: `session.session` has all that a page shows and commands.
All other modules show it with viser, and only they import what `[view]` installs: `scene` is drawn, `panels` are the
controls, `server` passes messages and files between the page and the session. `view` puts all together. `replay`
records the scene into one file, without a session and a server.
"""

from ballbot_rs.viewer.session import Session

__all__ = ["Session"]
