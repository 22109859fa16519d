"""A self-contained HTML file: pictures and videos are in it, and it makes no requests."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_STYLE = """
:root { color-scheme: light dark; --ink: #212529; --paper: #fff; --line: #dee2e6; --card: #f1f3f5; --soft: #495057; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e9ed; --paper: #16191d; --line: #3a414b; --card: #23272e; --soft: #b3bac4; }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; border-bottom: 1px solid var(--line); }
img, video { max-width: 100%; height: auto; border-radius: 4px; } img { background: #fff; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .85rem; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid var(--line); } th { font-weight: 600; }
th:first-child, td:first-child, .pairs td { text-align: left; }
pre { background: var(--card); padding: .8rem; overflow-x: auto; font-size: .85rem; }
.note { color: var(--soft); font-size: .9rem; } .wide { overflow-x: auto; }
"""


def page(title: str, parts: Sequence[str]) -> str:
    """A whole document."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<style>{_STYLE}</style>\n</head>\n'
        f"<body>\n<h1>{html.escape(title)}</h1>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def section(title: str, *parts: str) -> str:
    """A heading and its content."""
    return f"<h2>{html.escape(title)}</h2>\n" + "\n".join(parts)


def note(text: str) -> str:
    """A paragraph of small print."""
    return f'<p class="note">{html.escape(text)}</p>'


def code(text: str) -> str:
    """Preformatted text."""
    return f"<pre>{html.escape(text)}</pre>"


def table(rows: Sequence[Sequence[str]]) -> str:
    """A table; its first row is the header."""
    cells = [[html.escape(cell) for cell in row] for row in rows]
    head, *body = cells
    lines = [f"<tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr>"]
    lines += [f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in body]
    return '<div class="wide"><table>\n' + "\n".join(lines) + "\n</table></div>"


def pairs(rows: Sequence[tuple[str, str]]) -> str:
    """Names and texts, one per line."""
    lines = [f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in rows]
    return '<div class="wide"><table class="pairs">\n' + "\n".join(lines) + "\n</table></div>"


def figure(drawn: Any, description: str) -> str:
    """A matplotlib figure, as vectors."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return f'<img alt="{html.escape(description)}" src="{_data("image/svg+xml", buffer.getvalue())}">'


def video(path: Path) -> str:
    """An mp4, played in a loop."""
    return f'<video controls autoplay loop muted playsinline src="{_data("video/mp4", path.read_bytes())}"></video>'


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
