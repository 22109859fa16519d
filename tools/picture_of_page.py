"""Draws the picture of the page in the README, in Chromium: `python tools/picture_of_page.py docs/page.webp`."""

import io
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from PIL import Image

from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.view import View
from tests.support.chromium import Chromium, find_browser
from tests.support.waiting import wait_until

#: Size of the window, px, and of the picture, px.
WINDOW, WIDTH = (1400, 900), 1000

#: Simulated time of the picture, s: robot and shadow are next to the trail.
TIME = 15.0


def begin(session: Session) -> None:
    """A figure eight under LQR."""
    session.reset((0.0, 0.0))
    session.follow("eight")


def main(path: Path) -> None:
    """Writes the picture."""
    browser = find_browser()
    if browser is None:
        raise SystemExit("no Chromium: on Debian `apt install chromium`")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        session = Session()
        view, page = View(session, port=18990), Chromium(browser, folder)
        try:
            width, height = WINDOW
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            page.call("Page.navigate", url=view.url)
            page.wait_for("document.querySelector('canvas[data-engine]') && document.querySelector('.ballbot-status')")
            wait_until(view.server.get_clients)
            # viser warns of software rendering.
            page.evaluate(
                "document.head.insertAdjacentHTML('beforeend', "
                "'<style>.mantine-Notifications-root { display: none }</style>')"
            )
            page.click(*page.place_of("[...document.querySelectorAll('[role=tab]')].find(t => t.title === 'Plots')"))
            view._page._scene.shows_forces = True
            view.runner.submit(begin)
            # Before it begins, the time may be larger: a page takes long to load on a busy machine.
            wait_until(lambda: session.time < TIME)
            wait_until(lambda: session.time > TIME)
            view.runner.submit(lambda session: setattr(session, "paused", True))
            # Software rendering lags by some frames, and by seconds on a busy machine.
            time.sleep(20.0)
            picture = Image.open(io.BytesIO(page.screenshot(folder / "page.png"))).convert("RGB")
        finally:
            page.close()
            view.stop()
    picture.resize((WIDTH, WIDTH * height // width), Image.Resampling.LANCZOS).save(path, quality=80, method=6)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
