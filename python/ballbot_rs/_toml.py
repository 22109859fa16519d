"""TOML: reads with the core's parser, and writes plain tables."""

import json
import re
from collections.abc import Mapping
from typing import Any

from ballbot_rs._core import _toml_table


def loads(text: str) -> dict[str, Any]:
    """The table of a TOML text; dates and times are texts.

    Raises:
        ValueError: malformed TOML.
    """
    return _toml_table(text)


def dumps(table: Mapping[str, Any]) -> str:
    """A table of numbers, texts, lists, tables and lists of tables as TOML."""
    return "\n".join(_lines(table, ())) + "\n"


def _lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [
        f"{_key(name)} = {json.dumps(value)}"
        for name, value in table.items()
        if not isinstance(value, Mapping) and not _is_list_of_tables(value)
    ]
    for name, value in table.items():
        inner = (*path, name)
        if isinstance(value, Mapping):
            lines += ["", f"[{'.'.join(map(_key, inner))}]", *_lines(value, inner)]
        elif _is_list_of_tables(value):
            for one in value:
                lines += ["", f"[[{'.'.join(map(_key, inner))}]]", *_lines(one, inner)]
    return lines


def _key(name: str) -> str:
    """A key, in quotes if it needs them."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name)


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and bool(value) and all(isinstance(one, Mapping) for one in value)
