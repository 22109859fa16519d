"""Highlighted files of the clone that pages link to, as pages of the site; and links to the Rust documentation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx.application import Sphinx

from website.paths import ROOT


def _resolve(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Makes `source:PATH` and `rust:PATH` relative to a page."""
    linked = app.env.linked_sources = getattr(app.env, "linked_sources", set())
    for node in doctree.findall(nodes.reference):
        scheme, _, target = node.get("refuri", "").partition(":")
        up = "../" * page.count("/")
        if scheme == "source":
            path, _, fragment = target.partition("#")
            linked.add(path)
            node["refuri"] = f"{up}source/{path}.html" + (f"#{fragment}" if fragment else "")
        elif scheme == "rust":
            node["refuri"] = f"{up}rust/{target}"


def _highlighted(path: str) -> str:
    file = ROOT / path
    if file.is_dir():
        entries = [f'<li><a href="{file.name}/{name}.html">{name}</a></li>' for name in _within(file)]
        return f"<h1>{path}</h1><ul>{''.join(entries)}</ul>"
    try:
        lexer = get_lexer_for_filename(file.name, stripnl=False)
    except ClassNotFound:
        lexer = TextLexer(stripnl=False)
    # `linespans` names the lines, so that a link can point to a line.
    formatter = HtmlFormatter(linespans="L", wrapcode=True)
    return f"<h1>{path}</h1>{highlight(file.read_text(encoding='utf-8'), lexer, formatter)}"


def _within(folder: Path) -> list[str]:
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*.*") if file.suffix != ".pyc")


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    linked = set(getattr(app.env, "linked_sources", ()))
    linked |= {f"{path}/{name}" for path in linked if (ROOT / path).is_dir() for name in _within(ROOT / path)}
    for path in sorted(linked):
        yield f"source/{path}", {"title": path, "body": _highlighted(path), "furo_hide_toc": True}, "page.html"


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects both."""
    app.connect("doctree-resolved", _resolve)
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
