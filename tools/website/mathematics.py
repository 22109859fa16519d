"""Mathematics as MathML, made when the site is built: browsers draw it without scripts or external fonts."""

import html
import re
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

SPACE = "{http://www.w3.org/1998/Math/MathML}"
ElementTree.register_namespace("", SPACE[1:-1])
#: Input that GitHub's renderer accepts and the converter does not.
INSTEAD = (
    (r"\\cr\b", r"\\\\"),
    (r"\\gt\b", ">"),
    (r"\\lt\b", "<"),
    (r"\\dots\b", r"\\ldots"),
    (r"\\([dt]?frac)(\d)(\d)", r"\\\1{\2}{\3}"),
    (r"^\^", "{}^"),
)
#: Names of HTML that XML does not have.
ENTITY = re.compile(r"&(?!amp;|lt;|gt;)\w+;")
APPLICATION = "\N{FUNCTION APPLICATION}"
ROWS = {f"{SPACE}{name}" for name in ("math", "mrow", "mtd", "mstyle", "msqrt")}
UNSPACED = {f"{SPACE}mo", f"{SPACE}mspace", f"{SPACE}mtext"}
ACCENTS = "˙¨ˆ˜¯→"
BARS = "|‖∥"


def mathml(tex: str, is_block: bool) -> str:
    """A formula as MathML; raises MathError, which names the unknown part."""
    for pattern, replacement in INSTEAD:
        tex = re.sub(pattern, replacement, tex)
    formula = ElementTree.fromstring(
        ENTITY.sub(lambda found: html.unescape(found[0]), tex2mathml(tex, as_block=is_block))
    )
    for element in formula.iter():
        if element.tag == f"{SPACE}munderover" and element[2].text in ACCENTS:
            _index_next_to(element)
        _close_bars(element)
        if element.tag in ROWS:
            _space_functions(element)
    return ElementTree.tostring(formula, encoding="unicode")


def _index_next_to(element: ElementTree.Element) -> None:
    """Moves the index of an accented letter to its side; the converter puts it below."""
    letter, index, accent = element
    element.tag = f"{SPACE}msub"
    element[:] = [ElementTree.Element(f"{SPACE}mover", accent="true"), index]
    element[0].extend([letter, accent])


def _close_bars(element: ElementTree.Element) -> None:
    """Makes bars open and close; a browser would space them as the relation "divides"."""
    for place, child in enumerate(element):
        is_delimiter = element.tag == f"{SPACE}mrow" and place in (0, len(element) - 1)
        if child.tag == f"{SPACE}mo" and child.text in BARS and not is_delimiter:
            child.set("form", "prefix" if child.get("class") == "mathopen" else "postfix")
            child.set("stretchy", "false")


def _space_functions(element: ElementTree.Element) -> None:
    """Puts thin spaces around names of functions, except before a bracket and after an operator."""
    spaced: list[ElementTree.Element] = []
    for child in element:
        before = next((other for other in reversed(spaced) if other.text != APPLICATION), None)
        # A function after an operand, or its argument.
        names = [other is not None and _is_function(other) for other in (before, child)]
        if any(names) and before is not None and not {before.tag, child.tag} & UNSPACED and child.text != APPLICATION:
            spaced.append(ElementTree.Element(f"{SPACE}mspace", width="0.17em"))
        spaced.append(child)
    element[:] = spaced


def _is_function(element: ElementTree.Element) -> bool:
    """Whether it is a name of several letters, with or without an exponent."""
    name = element if not len(element) else element[0]
    return name.tag == f"{SPACE}mi" and len(name.text or "") > 1 and name.text.isalpha()


def _append(translator: Any, node: nodes.Element, is_block: bool) -> None:
    try:
        formula = mathml(node.astext().strip(), is_block)
    except MathError as error:
        logging.getLogger(__name__).warning("%s in %s", error, node.astext(), location=node)
        formula = ""
    translator.body.append(f'<div class="formula">{formula}</div>' if is_block else formula)
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the renderer."""
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(lambda translator, node: _append(translator, node, False), None),
        block_renderers=(lambda translator, node: _append(translator, node, True), None),
    )
    return {"parallel_read_safe": True, "parallel_write_safe": True}
