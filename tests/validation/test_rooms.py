"""The rooms of `validation/` import only those before them."""

import ast

import pytest

from tests.support.paths import ROOT

HOUSE = ROOT / "validation"
ROOMS = (
    "engines",
    "closed_forms",
    "robots",
    "controllers",
    "policies",
    "against_engines",
    "paper_replication",
    "benchmarks",
    "firmware",
)


@pytest.mark.parametrize("room", ROOMS)
def test_imports_go_to_rooms_before(room: str) -> None:
    later = {f"validation.{name}" for name in ROOMS[ROOMS.index(room) + 1 :]}
    modules = sorted((HOUSE / room).glob("*.py"))
    assert modules
    for path in modules:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                assert not {".".join(name.split(".")[:2]) for name in names} & later, path


def test_the_list_of_rooms_is_current() -> None:
    assert {path.parent.name for path in HOUSE.glob("*/__init__.py")} == set(ROOMS)
