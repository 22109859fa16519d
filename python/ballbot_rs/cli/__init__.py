"""The `ballbot` command."""

import argparse
import sys
from collections.abc import Sequence

from ballbot_rs import __version__
from ballbot_rs.cli import evaluate, train, view

#: Exit codes: 1 for an error that the message explains, 2 for a wrong command line, 130 for an interrupt.
FAILED = 1
INTERRUPTED = 130


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    parser = argparse.ArgumentParser(prog="ballbot", description="Simulate, train, evaluate and view ballbots.")
    parser.add_argument("--version", action="version", version=f"ballbot {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    train.add_to(commands)
    evaluate.add_to(commands)
    view.add_to(commands)
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
