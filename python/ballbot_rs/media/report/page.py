"""A self-contained HTML file: pictures, videos and replays are in it, and it makes no requests."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_STYLE = """
:root { --ink: light-dark(#212529, #e6e9ed); --paper: light-dark(#fff, #16191d); --line: light-dark(#dee2e6, #3a414b); }
:root { --card: light-dark(#f1f3f5, #23272e); --soft: light-dark(#495057, #b3bac4); }
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
iframe { width: 100%; aspect-ratio: 8 / 5; min-height: 21rem; margin-top: 1rem; }
iframe { border: 1px solid var(--line); border-radius: 4px; }
.timed { position: relative; width: fit-content; } .timed img { display: block; }
.timed i { position: absolute; pointer-events: none; }
.timed i::after { content: ""; position: absolute; height: 100%; border-left: 1.5px solid #212529; }
.timed i::after { left: calc(100% * clamp(0, (var(--time, 0) - var(--begin)) / var(--seconds), 1)); }
"""

#: Nothing comes from elsewhere; the player of a replay compiles its own code.
_POLICY = "default-src 'unsafe-inline' 'unsafe-eval' data: blob:"

#: Takes the time of a replay to the marks in `timed_figure`.
_CLOCK = """
addEventListener("message", ({ source, data }) => {
  if (source === document.querySelector("iframe").contentWindow && Number.isFinite(data))
    document.documentElement.style.setProperty("--time", data);
});
"""


def page(title: str, parts: Sequence[str], scheme: str = "light dark") -> str:
    """A whole document, in light or dark colors or, with both, in the system's."""
    return (
        f'<!DOCTYPE html>\n<html lang="en" style="color-scheme: {scheme}">\n<head>\n<meta charset="utf-8">\n'
        f'<title>{html.escape(title)}</title>\n<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
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


def timed_figure(drawn: Any, description: str, spans: Sequence[tuple[float, float]]) -> str:
    """The same with a line in each of its axes at the time of the replay in this document.

    Args:
        drawn: the figure, whose axes have time to the right.
        description: for readers who do not see it.
        spans: of each of its axes: the times between which the line moves, s.
    """
    image = figure(drawn, description)
    to_figure = drawn.transFigure.inverted()
    lines = []
    for ax, (begin, end) in zip(drawn.axes, spans, strict=True):
        left, right = (to_figure.transform(ax.transData.transform((time, 0.0)))[0] for time in (begin, end))
        box = ax.get_position()
        place = {"left": left, "width": right - left, "top": 1.0 - box.y1, "height": box.height}
        style = "; ".join(f"{name}: {100.0 * value:.3f}%" for name, value in place.items())
        lines.append(f'<i style="{style}; --begin: {begin:g}; --seconds: {end - begin:g}"></i>')
    return f'<div class="timed">{image}{"".join(lines)}</div>'


def replay(document: str) -> str:
    """A document that sends its time, s, in an iframe; a page has at most one."""
    # Without the right of its origin it reads nothing of the page around it.
    shown = f'<iframe title="replay in 3D" sandbox="allow-scripts" srcdoc="{html.escape(document)}"></iframe>'
    return f"{shown}<script>{_CLOCK}</script>"


def video(path: Path) -> str:
    """An mp4, played in a loop."""
    return f'<video controls autoplay loop muted playsinline src="{_data("video/mp4", path.read_bytes())}"></video>'


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
