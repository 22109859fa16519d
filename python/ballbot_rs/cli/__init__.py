"""The `ballbot` command."""

import argparse
import contextlib
import sys
from collections.abc import Sequence

from ballbot_rs import __version__
from ballbot_rs.cli import evaluate, export, info, plot, record, report, train, view

#: Exit codes: 1 for an error that the message explains, 2 for a wrong command line, 130 for an interrupt.
FAILED = 1
INTERRUPTED = 130

DESCRIPTION = "Simulate, train, evaluate and show ballbots."
EPILOG = "Exit codes: 0 done, 1 an error that the message explains, 2 a wrong command line, 130 interrupted."


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    parser = argparse.ArgumentParser(prog="ballbot", description=DESCRIPTION, epilog=EPILOG)
    parser.add_argument("--version", action="version", version=f"ballbot {__version__}")
    with contextlib.suppress(ModuleNotFoundError):
        import shtab

        shtab.add_argument_to(parser, "--print-completion", help="print a script of completions for a shell")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    train.add_to(commands)
    for command in (evaluate, report, export, plot, record, view, info):
        command.add_to(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parsed = parser().parse_args(arguments)
    try:
        parsed.carry_out(parsed)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError, ModuleNotFoundError, ArithmeticError, TypeError) as error:
        print(f"ballbot: {error}", file=sys.stderr)
        return FAILED
    return 0
