"""`ballbot report`: one HTML file about a training run."""

import argparse
import contextlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from ballbot_rs._progress import Progress
from ballbot_rs.analysis.episodes import MAX_EPISODES
from ballbot_rs.analysis.result import Result
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options.numbers import seconds, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.media.report.report import write

#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("report runs/mine", "write the report of a run again"),
    ("report runs/mine --episodes 0 --video-seconds 10 -o mine.html", "without the comparison, with a longer video"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("report", help="write a training run's report, one HTML file", examples=EXAMPLES)
    command.add_argument("run", type=Path, metavar="RUN", help="the run's folder")
    shared.add_output(command, "FILE.html", "the file (default report.html in the run)")
    command.add_argument(
        "--episodes", type=whole(0, MAX_EPISODES), default=100, help="episodes of the comparison (default 100, 0: none)"
    )
    command.add_argument(
        "--video-seconds", type=seconds(), default=4.0, help="length of the video (default 4, 0: none)"
    )
    shared.add_verbosity(command, "the file's name")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    path = _write(
        arguments.run,
        arguments.quiet or arguments.json,
        target=arguments.output,
        episodes=arguments.episodes,
        video_seconds=arguments.video_seconds,
    )
    print(json.dumps({"report": str(path)}) if arguments.json else f"wrote {path}")


def after_training(folder: Path, results: Sequence[Result], quiet: bool) -> Path | None:
    """Writes the report after a training run; if it cannot, prints the reason to standard error and continues."""
    try:
        return _write(folder, quiet, results=results, episodes=0)
    except (ModuleNotFoundError, OSError, ValueError) as error:
        print(f"no report: {error}", file=sys.stderr)
        return None


def _write(folder: Path, quiet: bool, **arguments: Any) -> Path:
    with contextlib.ExitStack() as shown:

        def part(name: str) -> Progress:
            shown.close()
            return shown.enter_context(bar(name, quiet))

        return write(folder, progress=part, **arguments)
