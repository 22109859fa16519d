"""What `help` shows of the Rust classes is what the stub says."""

import ast
import inspect
from pathlib import Path

import ballbot_rs._core as core

STUB = ast.parse((Path(core.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))


def documented(nodes, owner, prefix=""):
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            yield f"{prefix}{node.name}", ast.get_docstring(node), getattr(owner, node.name)
            yield from documented(node.body, getattr(owner, node.name), f"{node.name}.")
        elif isinstance(node, ast.FunctionDef) and ast.get_docstring(node) and node.name != "__call__":
            yield f"{prefix}{node.name}", ast.get_docstring(node), getattr(owner, node.name)


def test_docstrings_of_stub_and_runtime_are_equal():
    compared = 0
    for name, expected, found in documented(STUB.body, core):
        assert inspect.getdoc(found) == expected, name
        compared += 1
    assert compared > 60
