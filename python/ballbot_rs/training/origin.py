"""Origin of a run: date, machine, command and commit, for its record and its report."""

import datetime
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Final

from ballbot_rs import _machine

#: Timeout of git, s.
GIT_SECONDS: Final = 10.0
PACKAGE: Final = Path(__file__).resolve().parents[1]


def origin() -> dict[str, str]:
    """Date, machine, command, and the commit of the package if it is a clone; unknown parts are omitted."""
    found = {"started": now(), "machine": _machine.described(), "command": command()}
    version = commit(PACKAGE)
    return found if version is None else {**found, "commit": version}


def now() -> str:
    """Date and time with the offset of the local clock, to the second."""
    return datetime.datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")


def command() -> str:
    """The command line of this process, in shell syntax; the program without its folder."""
    program, *arguments = sys.argv or ["python"]
    # `python -m ballbot_rs.cli` runs `ballbot`.
    name = "ballbot" if Path(program) == PACKAGE / "cli" / "__main__.py" else Path(program).name
    return shlex.join([name or "python", *arguments])


def commit(folder: Path) -> str | None:
    """The commit of the clone that contains the package, and whether it was changed since; None without a clone."""
    ours = folder.parents[1]
    if not (ours / ".git").exists():
        return None
    head = _git(ours, "rev-parse", "--short=12", "HEAD")
    changes = _git(ours, "status", "--porcelain", "--untracked-files=no")
    if not head:
        return None
    return f"{head}, with changes" if changes else head


def _git(folder: Path, *arguments: str) -> str | None:
    command_line = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command_line, capture_output=True, text=True, timeout=GIT_SECONDS, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
