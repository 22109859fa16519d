"""The `ballbot` command."""

import argparse
import contextlib
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

from ballbot_rs import __version__, _interrupts
from ballbot_rs._extras import install_hint
from ballbot_rs._modules import import_from_here
from ballbot_rs.cli import streams
from ballbot_rs.cli.commands import (
    compare,
    evaluate,
    export,
    identify,
    info,
    link,
    list_names,
    plot,
    record,
    record_log,
    replay,
    report,
    simulate,
    train,
    tune,
    view,
)
from ballbot_rs.cli.grammar import Parser
from ballbot_rs.envs.own.source import import_source

#: Exit code of an error that its message explains.
FAILED = 1
#: Errors that their messages explain; any other error is a bug of ours, and is shown with its traceback.
ERRORS = (ValueError, OSError, ImportError, ArithmeticError, TypeError, RuntimeError, MemoryError)

DESCRIPTION = "Simulate, train, evaluate and show ballbots."
EPILOG = (
    "Exit codes: 0 done, 1 an error that the message explains, 2 a wrong command line, 130 interrupted, "
    "141 output closed by its reader, 143 terminated."
)

EXAMPLES = (
    ("list", "the names of robots, tasks, controllers and policies"),
    ("view --controller lqr", "a robot in the browser, to push it"),
    ("evaluate --controller lqr --controller pid --episodes 20", "two controllers from the same starts"),
    ("train balance --timesteps 1e5", "a policy"),
)

COMPLETION = "--print-completion"
COMMANDS = (
    train,
    tune,
    evaluate,
    compare,
    report,
    export,
    simulate,
    plot,
    record,
    view,
    record_log,
    identify,
    replay,
    link,
    list_names,
    info,
)


class _Import(argparse.Action):
    """Imports a module, also from the current folder."""

    def __call__(self, _parser: argparse.ArgumentParser, _namespace: object, module: Any, _flag: object = None) -> None:
        import_from_here()
        import_source(module)


class _MissingCompletion(argparse.Action):
    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        raise ModuleNotFoundError(f"{COMPLETION} needs shtab: install it with `{install_hint('completion')}`")


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    parser = Parser(prog="ballbot", description=DESCRIPTION, epilog=EPILOG, examples=EXAMPLES)
    parser.add_argument("--version", action="version", version=f"ballbot {__version__}")
    parser.add_argument(
        "--import",
        metavar="MODULE|FILE.py",
        action=_Import,
        help="import a module or file first: it has tasks in Python, or functions that policies were trained with",
    )
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
    for action in commands._choices_actions:
        assert action.help is not None
        commands.choices[action.dest].description = f"{action.help[0].upper()}{action.help[1:]}."
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Carries a command out; returns its exit code."""
    with streams.prepared(), warnings.catch_warnings():
        warnings.showwarning = _print_warning
        try:
            _carry_out(arguments)
        except KeyboardInterrupt as error:
            return _interrupted(error.number if isinstance(error, _interrupts.Terminated) else signal.SIGINT)
        except BrokenPipeError:
            return streams.BROKEN_PIPE
        except ERRORS as error:
            streams.complain("ballbot", _message(error))
            return FAILED
    return 0


def run() -> int:
    """Carries out the command of this process, and ends the process if it is interrupted."""
    _interrupts.install()
    code = main()
    if code in map(_interrupts.exit_code, _interrupts.WORDS):
        # Python would collect torch's garbage for seconds. All output is written, and flushed here.
        sys.stderr.flush()
        os._exit(code)
    return code


def _carry_out(arguments: Sequence[str] | None) -> None:
    try:
        grammar = parser()
        parsed = grammar.parse_args(arguments)
        if parsed.command is None:
            grammar.print_help()
        else:
            parsed.carry_out(parsed)
    finally:
        streams.flush()


def _interrupted(number: signal.Signals) -> int:
    # A terminal that has hung up takes no output.
    with contextlib.suppress(OSError):
        print(_interrupts.WORDS[number], file=sys.stderr)
    return _interrupts.exit_code(number)


def _message(error: BaseException) -> str:
    """An error on one line, with the name of its file."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    elif isinstance(error, MemoryError):
        text = f"not enough memory{f': {error}' if str(error) else ''}"
    else:
        text = str(error) or type(error).__name__
    return " ".join(text.split())


def _print_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    # Other warnings are for the authors of the libraries that issue them.
    if issubclass(category, UserWarning):
        print(f"ballbot: warning: {message}", file=sys.stderr)
