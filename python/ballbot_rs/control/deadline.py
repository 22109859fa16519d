"""A time limit for runs of onnxruntime: a model may have a loop without end."""

import threading
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar

_Result = TypeVar("_Result")

#: Period of the checks of running calls, and idle time after which the thread ends, s.
PERIOD: Final = 0.05
IDLE: Final = 5.0

_lock = threading.Lock()
#: By thread, the deadline of its run, and the options that end it.
_running: dict[int, tuple[float, Any]] = {}
_watcher: threading.Thread | None = None


def run(seconds: float, options: Any, call: Callable[[Any], _Result]) -> _Result:
    """Calls with `options`, a separate `RunOptions` of onnxruntime, which ends the call after a time limit.

    Raises:
        TimeoutError: it took longer.
    """
    global _watcher
    ends = time.monotonic() + seconds
    with _lock:
        _running[threading.get_ident()] = (ends, options)
        if _watcher is None:
            _watcher = threading.Thread(target=_watch, name="onnxruntime deadline", daemon=True)
            _watcher.start()
    try:
        return call(options)
    # Its exceptions have no common base class.
    except Exception as error:
        # Another thread may have ended it sooner.
        if options.terminate and time.monotonic() > ends:
            raise TimeoutError(f"it ran for more than {seconds:g} s") from error
        raise
    finally:
        with _lock:
            del _running[threading.get_ident()]


def _watch() -> None:
    global _watcher
    worked = time.monotonic()
    while True:
        time.sleep(PERIOD)
        now = time.monotonic()
        with _lock:
            for deadline, options in _running.values():
                worked = now
                if now > deadline:
                    options.terminate = True
            if now - worked > IDLE:
                _watcher = None
                return
