"""A headless Chromium driven by its own DevTools protocol: no driver program, no package except websockets."""

import base64
import contextlib
import itertools
import json
import os
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path

from websockets.sync.client import connect

from tests.support.waiting import LIMIT

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

#: Software WebGL, so that no GPU is needed.
FLAGS = [
    "--headless=new",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--remote-debugging-port=0",
    "--window-size=1280,800",
]


def find_browser() -> str | None:
    """The path of a Chromium, or None. A snap does not count: other programs do not see its files."""
    paths = (path for name in NAMES if (path := shutil.which(name)))
    return next((path for path in paths if not str(Path(path).resolve()).startswith("/snap")), None)


class CallError(AssertionError):
    """The browser answered a call with an error."""


class Chromium:
    """One page. Keeps console messages and uncaught exceptions in `errors`."""

    def __init__(self, browser: str, folder: Path) -> None:
        self.errors: list[str] = []
        self._open = contextlib.ExitStack()
        sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        with (folder / "chromium.log").open("w") as log:
            self._process = subprocess.Popen(
                [browser, *FLAGS, *sandbox, f"--user-data-dir={folder / 'profile'}", "about:blank"],
                stdout=log,
                stderr=log,
            )
        try:
            address = self._page_address(folder / "profile" / "DevToolsActivePort")
            self._connection = self._open.enter_context(connect(address, max_size=None))
        except BaseException:
            self._process.kill()
            raise
        self._numbers = itertools.count(1)
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def _page_address(self, port_file: Path) -> str:
        log = port_file.parents[1] / "chromium.log"
        ends = time.monotonic() + LIMIT
        while time.monotonic() < ends:
            assert self._process.poll() is None, f"the browser ended at once:\n{log.read_text()}"
            if port_file.exists() and port_file.read_text().strip():
                port = port_file.read_text().split()[0]
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=LIMIT) as answer:
                    pages = [page for page in json.load(answer) if page["type"] == "page"]
                if pages:
                    return pages[0]["webSocketDebuggerUrl"]
            time.sleep(0.05)
        raise AssertionError(f"the browser opened no debugging port in {LIMIT} s:\n{log.read_text()}")

    def call(self, method: str, **params):
        """Result of a method of the protocol."""
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self._connection.recv(timeout=LIMIT))
            if message.get("id") == number:
                if "error" in message:
                    raise CallError(message["error"]["message"])
                return message["result"]
            self._note(message)

    def _note(self, message):
        params = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif message.get("method") == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.errors.append(" ".join(str(a.get("value", a.get("description"))) for a in params["args"]))
        elif message.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"] + " " + params["entry"].get("url", ""))

    def evaluate(self, expression: str):
        """Value of a JavaScript expression."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Returns when a JavaScript expression is true."""
        ends = time.monotonic() + LIMIT
        while not self._is_true(expression):
            assert time.monotonic() < ends, f"waited {LIMIT} s for {expression}"
            time.sleep(0.05)

    def _is_true(self, expression: str) -> bool:
        try:
            return self.evaluate(f"Boolean({expression})")
        except CallError as error:
            # Another page loads.
            if "navigated" in str(error):
                return False
            raise

    def place_of(self, expression: str, seconds: float = LIMIT) -> tuple[float, float]:
        """The center of an element, scrolled into view, when it is clickable and no longer moves."""
        shown = f"(e => e && (e.scrollIntoView({{block: 'center'}}), e.getBoundingClientRect()))({expression})"
        center = f"(b => b && b.width > 0 ? [b.x + b.width / 2, b.y + b.height / 2] : null)({shown})"
        hit = "(([x, y], e) => e.contains(document.elementFromPoint(x, y)))"
        before = None
        ends = time.monotonic() + seconds
        while True:
            place = self.evaluate(center)
            if place is not None and place == before and self.evaluate(f"{hit}({json.dumps(place)}, {expression})"):
                return place[0], place[1]
            assert time.monotonic() < ends, f"waited {seconds} s for {expression} to be clickable"
            before = place
            time.sleep(0.1)

    def click(self, x: float, y: float) -> None:
        """A mouse click at a point of the window, with real events."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click_until(self, condition, *expressions: str) -> None:
        """Clicks elements in turn, and again where nothing follows: a busy page may move under a click."""
        ends = time.monotonic() + LIMIT
        outcome = "clicked"
        while not condition():
            assert time.monotonic() < ends, f"waited {LIMIT} s for what follows a click on {expressions}: {outcome}"
            try:
                for expression in expressions:
                    self.click(*self.place_of(expression, 5.0))
                outcome = "clicked"
            except AssertionError as error:
                outcome = str(error)
            again = time.monotonic() + 5.0
            while not condition() and time.monotonic() < again:
                time.sleep(0.05)

    def drag(self, start: tuple[float, float], end: tuple[float, float], moves: int = 12) -> None:
        """Drags with the left button."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=start[0], y=start[1])
        time.sleep(0.3)
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", clickCount=1)
        for i in range(1, moves + 1):
            x, y = (a + (b - a) * i / moves for a, b in zip(start, end, strict=True))
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
            time.sleep(0.03)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)

    def type_text(self, text: str) -> None:
        """Types into the element that has the focus."""
        self.call("Input.insertText", text=text)

    def press(self, key: str, code: int) -> None:
        """Presses a key such as Enter."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def screenshot(self, path: Path) -> bytes:
        """The window as PNG, saved to a file."""
        picture = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        path.write_bytes(picture)
        return picture

    def close(self, picture: Path | None = None) -> None:
        """Ends the browser, after a last picture, if it still answers."""
        if picture is not None:
            with contextlib.suppress(AssertionError, TimeoutError):
                self.screenshot(picture)
        self._open.close()
        self._process.terminate()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
