"""Progress bars of long commands: on a terminal's standard error, where `rich` is installed."""

import contextlib
import sys
from collections.abc import Iterator

from ballbot_rs._progress import Progress, no_progress


@contextlib.contextmanager
def bar(what: str, quiet: bool = False) -> Iterator[Progress]:
    """A progress bar, called with the amount done and the total; hidden when quiet or not on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield no_progress
        return
    try:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars
    except ModuleNotFoundError:
        yield no_progress
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(what, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)
