"""Formulas, docstrings and notebooks as the site has them; what needs docutils or Sphinx is skipped without them."""

import json
from xml.etree import ElementTree

import pytest

from tests.docs.test_docs import MATH_BLOCK, PAGES
from tests.support.paths import ROOT
from website import notebooks

MATHML = "{http://www.w3.org/1998/Math/MathML}"


@pytest.fixture
def mathml():
    pytest.importorskip("docutils", reason="docutils is missing: pip install -e '.[site]'")
    from website.mathematics import mathml

    return lambda tex: ElementTree.fromstring(mathml(tex, False))


def tags(element):
    return [child.tag.removeprefix(MATHML) for child in element.iter()]


@pytest.mark.parametrize("row", [r"\cr", r"\\"])
def test_rows_of_a_matrix_end_by_either_command(row, mathml):
    matrix = mathml(rf"\begin{{pmatrix}} a & b{row} c & d \end{{pmatrix}}")
    assert tags(matrix).count("mtr") == 2
    assert tags(matrix).count("mtd") == 4


def test_the_index_of_a_letter_with_an_accent_is_next_to_it(mathml):
    index = mathml(r"\dot\psi_i").find(f"{MATHML}msub")
    assert [child.tag for child in index] == [f"{MATHML}mover", f"{MATHML}mi"]
    assert [child.text for child in index[0]] == ["ψ", "˙"]
    assert index[1].text == "i"


def test_bars_open_and_close(mathml):
    bars = [element.get("form") for element in mathml(r"k\lvert w\rvert").iter() if element.text == "|"]
    assert bars == ["prefix", "postfix"]


def test_functions_have_space_on_both_sides_except_before_a_bracket(mathml):
    assert tags(mathml(r"l\sin\theta")).count("mspace") == 2
    assert tags(mathml(r"\operatorname{diag}(a)")).count("mspace") == 0
    assert tags(mathml(r"a = \cos\theta")).count("mspace") == 1


@pytest.mark.parametrize("tex", [r"\frac32", r"\gt", r"\dots", "^2"])
def test_math_that_github_renders_is_accepted(tex, mathml):
    assert tags(mathml(tex))[0] == "math"


def test_every_displayed_formula_is_converted(mathml):
    blocks = [block for page in PAGES for block in MATH_BLOCK.findall(page.read_text(encoding="utf-8"))]
    assert len(blocks) > 50
    for block in blocks:
        assert "merror" not in tags(mathml(block)), block


def test_docstrings_render_like_markdown():
    pytest.importorskip("sphinx", reason="Sphinx is missing: pip install -e '.[site]'")
    from website.signatures import restructured

    assert restructured("`a_*`s of *args, |x| and y_") == r"`a_*`\ s of \*args, \|x\| and y\_"
    assert restructured("See:\n\n```python\na * b\n```\n") == "See:\n\n::\n\n    a * b\n\n"


def test_signatures_of_the_extension_match_the_stub():
    pytest.importorskip("sphinx", reason="Sphinx is missing: pip install -e '.[site]'")
    from website.signatures import STUB, signatures

    known = signatures(STUB)
    assert known["Ballbot.step"] == ("(wheel_torques: npt.ArrayLike, steps: int=1)", "None")
    assert known["Ballbot"][0].startswith("(params: Params | str | PathLike[str] | None=None")
    assert known["Batch.contacts"] is None, "the runtime's own, as it has overloads"


def test_a_notebook_is_a_page_with_its_output():
    for name in ("first_steps", "learning"):
        text = (ROOT / "examples" / f"{name}.ipynb").read_text(encoding="utf-8")
        cells = json.loads(text)["cells"]
        page = notebooks.page(text)
        assert page.startswith("# ")
        assert page.count("```python\n") == sum(cell["cell_type"] == "code" for cell in cells)
        shown = [output for cell in cells for output in cell.get("outputs", ())]
        assert page.count('<div class="output">') == sum("text/html" in output.get("data", {}) for output in shown) > 0
