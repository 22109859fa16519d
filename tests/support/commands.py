"""The `ballbot` command in a separate process."""

import subprocess
import sys
import time
from pathlib import Path

from tests.support.paths import ROOT

#: Path of this package for a process started elsewhere.
IMPORT_PATH = [str(ROOT / "python"), str(ROOT)]

#: The command with a limit on the size of its files, which simulates a full disk.
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
from ballbot_rs.cli import main
sys.exit(main(sys.argv[2:]))
"""


def command(*arguments, largest_file=None):
    """The command line of a process."""
    head = ["-m", "ballbot_rs.cli"] if largest_file is None else ["-c", LIMITED, str(largest_file)]
    return [sys.executable, *head, *map(str, arguments)]


def run(*arguments, largest_file=None, timeout=120, **options):
    """Runs the command to its end."""
    options = {"capture_output": True, "text": True, "cwd": ROOT, **options}
    return subprocess.run(command(*arguments, largest_file=largest_file), timeout=timeout, check=False, **options)


def start(*arguments, **options):
    """Starts the command."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT, **options}
    return subprocess.Popen(command(*arguments), **options)


def wait_for(path: Path, process: subprocess.Popen, seconds: float = 60.0) -> None:
    """Returns when a file exists."""
    ends = time.monotonic() + seconds
    while not path.exists():
        assert process.poll() is None, f"ended with {process.returncode}: {process.communicate()}"
        assert time.monotonic() < ends, f"no {path} within {seconds} s"
        time.sleep(0.02)
