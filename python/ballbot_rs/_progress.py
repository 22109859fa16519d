"""Progress of long computations."""

from collections.abc import Callable

#: Called with the number of steps done and their total.
Progress = Callable[[int, int], None]


def no_progress(done: int, total: int) -> None:
    """A `Progress` that shows nothing."""
