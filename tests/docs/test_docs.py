"""The documentation is true: stubs match the runtime, links lead to files and names, derived limits hold."""

import ast
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import ballbot_rs as bb
import ballbot_rs._core as core
from tests.support.paths import ROOT
from validation.closed_forms import holdable_tilt
from validation.engines import probes
from validation.paper_replication import wheel_torques

STUB = ast.parse((Path(core.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])

#: `[text](target)` and `![text](target)`.
LINK = re.compile(r"!?\[([^\]]*)\]\(([^)\s]+)\)")
MATH = re.compile(r"\$\$.+?\$\$|\$[^$\n]+\$", flags=re.DOTALL)
MATH_BLOCK = re.compile(r"^```math\n(.+?)^```$", flags=re.DOTALL | re.MULTILINE)
#: What makes a name exist in a file of Rust or Python.
DEFINITION = (
    r"(?:\b(?:fn|struct|enum|trait|const|static|type|mod|impl(?:<[^>]*>)?(?:\s+\w+\s+for)?|def|class)\s+{name}\b"
    r"|^\s*(?:pub(?:\([a-z]+\))?\s+)?{name}\s*(?::|,$|\s=\s))"
)


def documented(nodes, owner, prefix=""):
    for node in nodes:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
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


def without_code(text):
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(text):
    """Anchors that GitHub gives the headings of a page."""
    titles = re.findall(r"^#+ (.+)$", without_code(text), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def missing_names(text, source):
    """Parts of `Type::member` that `source` does not define."""
    lines = "\n".join(line.split("//")[0] for line in source.splitlines())
    parts = re.split(r"::|\.", text)
    return [p for p in parts if not re.search(DEFINITION.format(name=re.escape(p)), lines, flags=re.MULTILINE)]


def broken_links(page, text):
    for label, target in LINK.findall(without_code(text)):
        path, _, fragment = target.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            yield f"{target}: no such file"
        elif fragment and fragment not in anchors(text if file == page else file.read_text(encoding="utf-8")):
            yield f"{target}: no such heading"
        elif file.suffix in (".rs", ".py", ".pyi"):
            name = re.fullmatch(r"`([\w:.]+)`", label)
            if not name:
                yield f"[{label}]({target}): the text must be the name of something in the file, in backticks"
            elif missing := missing_names(name[1], file.read_text(encoding="utf-8")):
                yield f"[{label}]({target}): the file does not define {', '.join(missing)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_to_names_in_them(page):
    assert list(broken_links(page, page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("[a](docs/nothing.md)", "no such file"),
        ("[a](docs/conventions.md#nothing)", "no such heading"),
        ("[`State::tilted`](crates/ballbot-base/src/energy.rs)", "does not define State, tilted"),
        ("[`State::frobnicate`](crates/ballbot-base/src/state.rs)", "does not define frobnicate"),
        ("[the state](crates/ballbot-base/src/state.rs)", "in backticks"),
    ],
)
def test_a_broken_link_is_found(line, complaint):
    (found,) = broken_links(ROOT / "README.md", line)
    assert complaint in found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_math_survives_markdown(page):
    """Between dollar signs, Markdown may consume backslashes before punctuation and separate `_` and `*` first.

    In blocks of code of the language `math` it consumes nothing.
    """
    text = page.read_text(encoding="utf-8")
    for block in MATH_BLOCK.findall(text):
        assert "$" not in block, f"dollar sign in {block}"
        assert block.count("{") == block.count("}"), f"unbalanced braces in {block}"
        assert block.count(r"\begin") == block.count(r"\end"), f"unbalanced environments in {block}"
    prose = re.sub(r"`[^`\n]*`", "", without_code(text))
    for formula in MATH.findall(prose):
        assert not re.search(r"\\[!-/:-@\[-`{-~]", formula), f"escaped punctuation in {formula}"
        assert not re.search(r"(?<![A-Za-z0-9])_(?=[A-Za-z0-9])|\*", formula), f"emphasis in {formula}"
        assert formula.count("{") == formula.count("}"), f"unbalanced braces in {formula}"
    assert prose.count("$") == sum(formula.count("$") for formula in MATH.findall(prose)), "unbalanced $"


PAPER = bb.Params.paper()


@pytest.mark.parametrize(("friction", "expected"), [(1.0, 29.7), (1.1, 31.6)])
def test_largest_tilt_that_can_be_held(friction, expected):
    found = np.degrees(holdable_tilt.largest_tilts(holdable_tilt.robot(friction)).min())
    assert found == pytest.approx(expected, abs=0.05)


def test_torque_at_which_a_wheel_of_the_upright_robot_slips():
    assert wheel_torques.tilt_onset(PAPER, PAPER.wheel_dynamic_friction) == pytest.approx(0.281, abs=5e-4)
    # Far below what the load at rest would allow, with the dynamic coefficient of 1.
    assert probes.resting_load(PAPER) * PAPER.wheel_radius == pytest.approx(0.515, abs=5e-4)
