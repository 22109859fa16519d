"""The grammar of the command line: a parser with short usage, examples, and errors that name what was meant."""

import argparse
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

from ballbot_rs._checks import closest, did_you_mean
from ballbot_rs.cli import streams
from ballbot_rs.cli.options.numbers import ANGLES, LENGTHS, TIMES

#: Exit code of a wrong command line.
WRONG: Final = 2

#: Widest help, and the column of its texts.
_WIDTH: Final = 100
_COLUMN: Final = 26


def _formatter(prog: str) -> argparse.HelpFormatter:
    return argparse.HelpFormatter(
        prog, max_help_position=_COLUMN, width=min(_WIDTH, shutil.get_terminal_size((_WIDTH, 24)).columns)
    )


class Parser(argparse.ArgumentParser):
    """A parser that names the option or command closest to an unknown name.

    Args:
        examples: command lines without the name of the program, each with what it does; `--help` ends with them.
        arguments: of argparse.
        options: of argparse.
    """

    def __init__(self, *arguments: Any, examples: Sequence[tuple[str, str]] = (), **options: Any) -> None:
        super().__init__(*arguments, **{"formatter_class": _formatter, **options})
        self.examples = examples
        # argparse takes -1e-3 for an option before Python 3.14, and -5deg in any.
        units = "|".join((*LENGTHS, *TIMES, *ANGLES))
        self._negative_number_matcher = re.compile(
            rf"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?({units})?$|-(inf|nan)$", re.IGNORECASE
        )
        #: Names that `--set` takes, by the option that a user may take them for.
        self.settings: Callable[[], dict[str, str]] = dict

    def format_usage(self) -> str:
        """One line: all options are in the help."""
        return f"usage: {self._usage()}\n"

    def _usage(self) -> str:
        formatter = self._get_formatter()
        given = [
            formatter._format_args(action, formatter._get_default_metavar_for_positional(action))
            for action in self._actions
            if not action.option_strings
        ]
        return " ".join([self.prog, "[OPTIONS]", *given])

    def format_help(self) -> str:
        """The help, with the examples at its end."""
        self.usage = self._usage().replace("%", "%%")
        text = super().format_help()
        self.usage = None
        if not self.examples:
            return text
        lines = [f"  {self.prog.partition(' ')[0]} {line}\n      {what}\n" for line, what in self.examples]
        return f"{text}\nexamples:\n{''.join(lines)}"

    def error(self, message: str) -> NoReturn:
        """Ends the process with the usage and, last, the message."""
        self.print_usage(sys.stderr)
        streams.complain(self.prog, message)
        sys.exit(WRONG)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Checks the names of the options, then parses."""
        given = list(sys.argv[1:] if args is None else args)
        known = list(self._option_string_actions)
        # A parser of commands leaves the options after a command to that command.
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
                self.error(f"unknown option {name}{self._meant(name, known)}")
        found, extra = super().parse_known_args(list(self._split(given)), namespace)
        if is_command and extra:
            self.error(f"unexpected argument: {' '.join(extra)}")
        return found, extra

    def _meant(self, name: str, known: Sequence[str]) -> str:
        """The option that is closest to an unknown name, or the key of `--set`."""
        if name == "--import":
            program, command = self.prog.split(" ", 1)
            return f": it goes before the command, {program} --import MODULE {command} ..."
        settings = self.settings()
        key = name.removeprefix("--").replace("-", "_")
        found = closest(key, [*settings, *(option.removeprefix("--") for option in known)])
        if found in settings:
            return f": did you mean '--set {settings[found]}=VALUE'?"
        return did_you_mean(name, known)

    def _split(self, given: Iterable[str]) -> Iterable[str]:
        """The arguments, with `0.3,0,0` as three numbers after an option that takes several."""
        several: argparse.Action | None = None
        for text in given:
            name, equals, value = text.partition("=")
            if name.startswith("--"):
                named = {action for option, action in self._option_string_actions.items() if option.startswith(name)}
                several = self._option_string_actions.get(name) or (named.pop() if len(named) == 1 else None)
                if not (several and isinstance(several.nargs, int) and several.nargs > 1 and several.type is not Path):
                    several = None
                elif equals:
                    yield name
                    yield from filter(None, value.split(","))
                    several = None
                    continue
                yield text
            elif several and "," in text:
                yield from filter(None, text.split(","))
                several = None
            else:
                yield text

    def _match_argument(self, action: argparse.Action, arg_strings_pattern: str) -> int:
        try:
            return super()._match_argument(action, arg_strings_pattern)
        except argparse.ArgumentError:
            if not isinstance(action.nargs, int) or action.nargs < 2 or action.type is Path:
                raise
            names = " ".join(action.metavar) if isinstance(action.metavar, tuple) else ""
            message = f"expected {action.nargs} numbers, {names}, with spaces or commas between them"
            raise argparse.ArgumentError(action, message) from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            expected = f"invalid choice: '{value}', expected one of {', '.join(choices)}"
            raise argparse.ArgumentError(action, f"{expected}{did_you_mean(str(value), choices)}")
