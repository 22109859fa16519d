"""Imported first: if this process is the command `ballbot`, from now on Ctrl-C ends it with one line.

The following imports take a third of a second, during which Python would print a traceback. In any other process this
module does nothing.
"""

import os
import sys

#: Names of the console script, and of the modules that run the command.
SCRIPTS = ("ballbot", "ballbot.exe")
MODULES = ("ballbot_rs", "ballbot_rs.cli")


def is_command() -> bool:
    """Whether this process was started as the command."""
    if sys.argv and sys.argv[0] == "-m":
        return any(sys.orig_argv[i : i + 2] == ["-m", name] for name in MODULES for i in range(len(sys.orig_argv)))
    return bool(sys.argv) and os.path.basename(sys.argv[0]) in SCRIPTS  # noqa: PTH119


if is_command():
    from ballbot_rs import _interrupts

    _interrupts.install()
