"""Equations as MathML: no script to load, nothing to fetch."""

from __future__ import annotations

import re
import shutil
from importlib.resources import as_file, files
from pathlib import Path

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)

#: Brackets and accents need a font with a table for mathematics, which many systems lack.
FONT = "STIXTwoMath-Regular.ttf"


def converted(node: nodes.Element, block: bool) -> str:
    """MathML of a math node; a warning and the source where that fails."""
    source = node.astext()
    if re.search(r"frac(?!\{)", source):  # \frac12 x becomes 12 over x without a word
        logger.warning("equation %r: write \\frac{1}{2}", source, location=node)
    try:
        return str(tex2mathml(source, as_block=block))
    except MathError as problem:
        logger.warning("equation %r: %s", source, problem, location=node)
        return f"<code>{source}</code>"


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(converted(node, block=False))
    raise nodes.SkipNode


def visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    self.body.append(converted(node, block=True))
    if node["number"]:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="eqno">({number})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def copy_font(app: Sphinx, problem: Exception | None) -> None:
    if problem is None and app.builder.format == "html":
        with as_file(files("ziamath") / "fonts" / FONT) as font:
            shutil.copyfile(font, Path(app.outdir, "_static", FONT))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("build-finished", copy_font)
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
