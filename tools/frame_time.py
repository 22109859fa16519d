"""Measures the time between two pictures of the page in a headless Chromium: `python tools/frame_time.py`.

Chromium draws in software here (SwiftShader), on the processor that also simulates: an upper bound for a machine with
a GPU.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.view import View
from tests.support.chromium import Chromium, find_browser

#: Size of the window, px, and number of pictures.
WINDOW, FRAMES = (1280, 800), 20

#: Resolves to the times between pictures, ms, after two that load.
MEASURE = """new Promise((resolve) => {
  const times = [];
  const next = (now) => {
    times.push(now);
    if (times.length < COUNT) requestAnimationFrame(next); else resolve(times.slice(1).map((t, i) => t - times[i]));
  };
  requestAnimationFrame(next);
})"""


def main() -> None:
    """Prints the median and the 95 % quantile with and without shadows."""
    browser = find_browser()
    if browser is None:
        raise SystemExit("no Chromium: on Debian `apt install chromium`")
    with tempfile.TemporaryDirectory() as name:
        view, page = View(Session(), port=18980), Chromium(browser, Path(name))
        try:
            width, height = WINDOW
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            page.call("Page.navigate", url=view.url)
            page.wait_for("document.querySelector('canvas[data-engine]') && document.querySelector('.ballbot-status')")
            for shadow in (True, False):
                view._page._scene.shows_shadow = shadow
                times = page.evaluate(MEASURE.replace("COUNT", str(FRAMES + 3)))[2:]
                median, high = np.quantile(times, (0.5, 0.95))
                print(f"{'with' if shadow else 'without'} shadows: median {median:.0f} ms, 95 % below {high:.0f} ms")
        finally:
            page.close()
            view.stop()


if __name__ == "__main__":
    main()
