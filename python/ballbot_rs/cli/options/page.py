"""The page in the browser, served until it is interrupted."""

import argparse
import atexit
import os
import sys
import threading
import time
import webbrowser
from typing import TYPE_CHECKING, Any

from ballbot_rs.cli.options.numbers import whole
from ballbot_rs.viewer.session import is_any_left

if TYPE_CHECKING:
    from ballbot_rs.viewer.view import View

PORT = 8080


def add_to(command: Any) -> None:
    """Adds the port, and whether a browser opens."""
    command.add_argument(
        "--port", type=whole(1, 65535), default=PORT, help=f"port of the page (default {PORT}, or the next free one)"
    )
    command.add_argument("--no-open", action="store_true", help="do not open the page")


def serve(view: "View", arguments: argparse.Namespace, seconds: float | None = None) -> None:
    """Serves the page for a time, s, or until Ctrl-C; ends with the real-time factor."""
    try:
        print(f"{view.url} shows the robot; Ctrl-C ends it", flush=True)
        if not arguments.no_open:
            threading.Thread(target=webbrowser.open, args=(view.url,), daemon=True).start()
        ends = time.monotonic() + (seconds or float("inf"))
        while view.runner.running and time.monotonic() < ends:
            time.sleep(0.05)
    finally:
        view.stop()
    _end_without(0 if view.runner.error is None else 1)
    if view.runner.error is not None:
        raise RuntimeError("the simulation has stopped") from view.runner.error
    print(view.runner.report())


def _end_without(code: int) -> None:
    """If a call does not return, ends the process anyway: its thread would crash after Python has ended."""
    if is_any_left():
        atexit.register(lambda: (sys.stdout.flush(), sys.stderr.flush(), os._exit(code)))
