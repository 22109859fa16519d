"""`--sweep NAME=V1,V2,...` and what is written of the study."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.analysis.study import Study
from ballbot_rs.cli.options.settings import value_of

FLAG: Final = "--sweep"

#: Options that need a sweep.
_OTHERS: Final = ("checkpoint", "value", "output")


def add_to(command: Any, names: str, value: str) -> None:
    """Adds the options of a sweep.

    Args:
        command: the parser to add them to.
        names: examples of what is swept.
        value: the column that is shown by default.
    """
    group = command.add_argument_group("sweep")
    group.add_argument(
        FLAG,
        action="append",
        default=[],
        metavar="NAME=V1,V2,...",
        help=f"values to compare at, of {names}; repeat for a grid",
    )
    group.add_argument(
        "--checkpoint", type=Path, metavar="FILE.json", help="saves completed points and resumes from them"
    )
    group.add_argument("--value", metavar="COLUMN", help=f"the number that is shown (default {value})")
    group.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="all numbers (.csv), or a figure of one or two names: curves or heat maps (.svg, .pdf, .png)",
    )


def read(arguments: argparse.Namespace, columns: Sequence[str]) -> dict[str, list[Any]] | None:
    """Values by name; None without a sweep.

    Args:
        arguments: of the command.
        columns: that may be shown: a wrong name is found before the study, and not after it.

    Raises:
        ValueError: another form, a name twice, or options that need a sweep.
    """
    if not arguments.sweep:
        for name in _OTHERS:
            if getattr(arguments, name) is not None:
                raise InvalidInputError(f"--{name} needs a sweep: add {FLAG} NAME=V1,V2,...")
        return None
    if arguments.value is not None and arguments.value not in columns:
        close = did_you_mean(arguments.value, columns) or f": expected one of {', '.join(columns)}"
        raise InvalidInputError(f"--value {arguments.value}: unknown column{close}")
    output = arguments.output
    if output is not None and output.suffix not in (".csv", ".svg", ".pdf", ".png"):
        raise InvalidInputError(f"{output}: the name must end in .csv for numbers, in .svg, .pdf or .png for a figure")
    found: dict[str, list[Any]] = {}
    for text in arguments.sweep:
        name, equals, values = text.partition("=")
        if not equals or not name or not values:
            raise InvalidInputError(f"{FLAG} {text}: expected NAME=V1,V2,...")
        if name in found:
            raise InvalidInputError(f"{FLAG} {text}: {name} is swept twice")
        try:
            # Values may be lists themselves.
            found[name] = json.loads(f"[{values}]")
        except ValueError:
            found[name] = [value_of(value.strip()) for value in values.split(",")]
    if output is not None and output.suffix != ".csv" and len(found) > 2:
        raise InvalidInputError(f"{output}: a figure shows one or two names, not {len(found)}: write a .csv")
    return found


def write(study: Study, arguments: argparse.Namespace) -> None:
    """Prints the study, and writes its file."""
    table = study.table(arguments.value)
    output = arguments.output
    if output is not None and output.suffix == ".csv":
        study.to_csv(output)
    elif output is not None:
        study.plot(arguments.value, output)
    if arguments.json:
        report = {"seed": arguments.seed, "ballbot_rs": __version__, "results": list(study.rows)}
        print(json.dumps(report, indent=2, allow_nan=False))
        return
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    print(f"{(arguments.value or study.value).replace('_', ' ')}:")
    for row in (table[0], ["-" * width for width in widths], *table[1:]):
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    if output is not None:
        print(f"wrote {output}")
