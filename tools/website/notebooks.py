"""Notebooks with their output as pages."""

import json
from typing import Any


def page(text: str) -> str:
    """The cells of a notebook as Markdown, each followed by its output."""
    return "\n\n".join(part for cell in json.loads(text)["cells"] for part in _parts(cell)) + "\n"


def _parts(cell: dict[str, Any]) -> list[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return [source]
    return [f"```python\n{source}\n```", *map(_shown, cell["outputs"])]


def _shown(output: dict[str, Any]) -> str:
    data = output.get("data", {})
    if "text/html" in data:
        return f'````{{raw}} html\n<div class="output">{"".join(data["text/html"])}</div>\n````'
    return f"```text\n{''.join(data.get('text/plain', output.get('text', ''))).rstrip()}\n```"
