"""Short texts of results, for prompts and notebooks; their attributes have all digits."""

import dataclasses
import html
from collections.abc import Iterable, Sequence
from typing import Any


def number(value: Any) -> str:
    """A number with four digits; anything else as it is."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def fields(instance: Any) -> str:
    """A dataclass of numbers as its constructor would be written, with four digits each."""
    parts = (f"{field.name}={number(getattr(instance, field.name))}" for field in dataclasses.fields(instance))
    return f"{type(instance).__name__}({', '.join(parts)})"


def table(rows: Iterable[Sequence[str]], header: Sequence[str] = ()) -> str:
    """An HTML table, without scripts."""
    lines = [_row(header, "th")] if header else []
    lines += [_row(row, "td") for row in rows]
    return f"<table>{''.join(lines)}</table>"


def _row(cells: Sequence[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
