"""The `ballbot` command."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from ballbot_rs import __version__
from ballbot_rs._checks import did_you_mean
from ballbot_rs._extras import install_hint
from ballbot_rs.cli import evaluate, export, info, plot, record, report, train, view

#: Exit codes: 1 for an error that the message explains, 2 for a wrong command line, 130 for an interrupt.
FAILED = 1
INTERRUPTED = 130

DESCRIPTION = "Simulate, train, evaluate and show ballbots."
EPILOG = "Exit codes: 0 done, 1 an error that the message explains, 2 a wrong command line, 130 interrupted."

COMPLETION = "--print-completion"
COMMANDS = (train, evaluate, report, export, plot, record, view, info)


class Parser(argparse.ArgumentParser):
    """A parser that names the closest option or command to one that it does not know."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses, after the names of the options have been checked."""
        given = list(sys.argv[1:] if args is None else args)
        known = list(self._option_string_actions)
        # A parser of commands leaves the options behind a command to that command.
        is_command = self._subparsers is None
        for text in given:
            if not text.startswith("-"):
                if is_command:
                    continue
                break
            name = text.partition("=")[0]
            if name == "--":
                break
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                self.error(f"unknown option {name}{did_you_mean(name, known)}")
        return super().parse_known_args(given, namespace)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            expected = f"invalid choice: '{value}', expected one of {', '.join(choices)}"
            raise argparse.ArgumentError(action, f"{expected}{did_you_mean(str(value), choices)}")


class _MissingCompletion(argparse.Action):
    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        raise ModuleNotFoundError(f"{COMPLETION} needs shtab: install it with `{install_hint('completion')}`")


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    parser = Parser(prog="ballbot", description=DESCRIPTION, epilog=EPILOG)
    parser.add_argument("--version", action="version", version=f"ballbot {__version__}")
    what = "print a script of completions for a shell"
    try:
        import shtab
    except ModuleNotFoundError:
        parser.add_argument(COMPLETION, metavar="SHELL", action=_MissingCompletion, help=what)
    else:
        shtab.add_argument_to(parser, COMPLETION, help=what)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    for command in COMMANDS:
        command.add_to(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    try:
        grammar = parser()
        parsed = grammar.parse_args(arguments)
        if parsed.command is None:
            grammar.print_help()
            return 0
        parsed.carry_out(parsed)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError, ModuleNotFoundError, ArithmeticError, TypeError) as error:
        print(f"ballbot: {error}", file=sys.stderr)
        return FAILED
    return 0
