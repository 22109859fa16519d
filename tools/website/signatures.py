"""Docstrings (Markdown) and signatures (with types of the extension's stub) in the form that Sphinx takes."""

import ast
import re
import textwrap
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from website.paths import ROOT

STUB = ROOT / "python" / "ballbot_rs" / "_core.pyi"
BLOCK = re.compile(r"^```\w*\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
CODE = re.compile(r"(^```.*?^```$|`[^`]+`)", flags=re.DOTALL | re.MULTILINE)
#: Outside backticks these have a meaning in reStructuredText.
MARKUP = re.compile(r"([*|]|(?<=\w)_(?!\w))")


def signatures(stub: Path) -> dict[str, tuple[str, str | None] | None]:
    """Arguments and returned type of every function and method of a stub; the constructor's are the class's."""
    found = {}
    tree = ast.parse(stub.read_text(encoding="utf-8"))
    aliases = {node.targets[0].id: node.value for node in tree.body if isinstance(node, ast.Assign)}
    for node in _Spelled(aliases).visit(tree).body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = _of(node)
        elif isinstance(node, ast.ClassDef):
            for member in node.body:
                if isinstance(member, ast.FunctionDef) and not _is(member, "property"):
                    name = node.name if member.name in ("__init__", "__new__") else f"{node.name}.{member.name}"
                    # Of a method with overloads the runtime's own signature has all arguments.
                    is_overload = _is(member, "overload")
                    found[name] = None if is_overload else _of(member)
    return found


class _Spelled(ast.NodeTransformer):
    """Replaces private type names by the types that they denote."""

    def __init__(self, aliases: dict[str, ast.expr]) -> None:
        self._aliases = {name: value for name, value in aliases.items() if name.startswith("_")}

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._aliases.get(node.id, node)


def _of(node: ast.FunctionDef) -> tuple[str, str | None]:
    arguments = node.args
    positional = arguments.posonlyargs or arguments.args
    if positional and positional[0].arg in ("self", "cls") and not _is(node, "staticmethod"):
        del positional[0]
    returned = node.returns and node.name not in ("__init__", "__new__")
    return f"({ast.unparse(arguments)})", ast.unparse(node.returns) if returned else None


def _is(node: ast.FunctionDef, decorator: str) -> bool:
    return any(isinstance(by, ast.Name) and by.id == decorator for by in node.decorator_list)


def restructured(text: str) -> str:
    """A docstring with converted Markdown code blocks, and escaped stars, bars and underscores."""
    parts = CODE.split(text)
    # A letter after the closing backtick would cancel it, as in the plural of a name.
    parts[2::2] = ["\\ " + part if part[:1].isalpha() else part for part in parts[2::2]]
    parts[::2] = [MARKUP.sub(r"\\\1", part) for part in parts[::2]]
    return BLOCK.sub(lambda block: "::\n\n" + textwrap.indent(block[1], "    "), "".join(parts))


def _docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:  # noqa: ARG001
    lines[:] = restructured("\n".join(lines)).split("\n")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects both."""
    known = signatures(STUB)

    def signature(app: Sphinx, what: str, name: str, obj: Any, *rest: Any) -> tuple[str, str | None] | None:  # noqa: ARG001
        return known.get(name.removeprefix("ballbot_rs."))

    app.connect("autodoc-process-signature", signature)
    # Before napoleon, which makes its own markup.
    app.connect("autodoc-process-docstring", _docstring, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
