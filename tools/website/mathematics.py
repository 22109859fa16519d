"""Mathematics as MathML, made when the site is built: browsers draw it without scripts or fonts from elsewhere."""

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

#: What GitHub's renderer takes and the converter does not.
INSTEAD = (
    (r"\\cr\b", r"\\\\"),
    (r"\\gt\b", ">"),
    (r"\\lt\b", "<"),
    (r"\\dots\b", r"\\ldots"),
    (r"\\([dt]?frac)(\d)(\d)", r"\\\1{\2}{\3}"),
    (r"^\^", "{}^"),
)


def mathml(tex: str, is_block: bool) -> str:
    """A formula as MathML; raises MathError, which says what is not known."""
    for pattern, replacement in INSTEAD:
        tex = re.sub(pattern, replacement, tex)
    return tex2mathml(tex, as_block=is_block)


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
