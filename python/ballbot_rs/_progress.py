"""Progress of long computations."""

from collections.abc import Callable

#: Called with the number of steps done and their total.
Progress = Callable[[int, int], None]


class _NoProgress:
    """A `Progress` that shows nothing, and is short in signatures."""

    def __call__(self, done: int, total: int) -> None:
        pass

    def __repr__(self) -> str:
        return "no_progress"


no_progress = _NoProgress()
