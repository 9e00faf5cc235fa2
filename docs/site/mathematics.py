"""Convert equations to MathML with docutils; a browser draws it without a network, a script or LaTeX."""

import html
import re
from typing import Any

from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

TAG = re.compile(r"\\tag\{([^}]*)\}")
SAME = (  # commands that the converter does not support, and their equivalents
    (re.compile(r"\\math(?:rel|bin|ord)(?=\{)"), ""),
    (re.compile(r"\\dots(?![a-z])"), r"\\ldots"),
    (re.compile(r"\\([td]?frac)\s*(\d)\s*(\d)"), r"\\\1{\2}{\3}"),
    (re.compile(r"(?<=\d)\{,\}(?=\d)"), ","),  # a decimal comma
    # else the index of a letter with an accent would be below the letter
    (re.compile(r"(\\(?:d?dot|bar|hat|tilde)\s*(?:\\?[A-Za-z]+|\{[^{}]*\}))(?=_)"), r"{\1{}}"),
)
log = logging.getLogger(__name__)


def mathml(tex: str, block: bool, place: Any = None) -> str:
    """Return the MathML of `tex`, with the number of an equation with \\tag{n}; log a warning for an invalid one."""
    number = TAG.search(tex)
    rest = TAG.sub("", tex)
    for pattern, replacement in SAME:
        rest = pattern.sub(replacement, rest)
    try:
        mathematics = tex2mathml(rest, as_block=block)
    except MathError as error:
        log.warning("equation %s: %s", tex, error, location=place)
        return f"<code>{html.escape(tex)}</code>"
    if not block:
        return mathematics
    equation_number = f'<span class="eqno">({html.escape(number.group(1))})</span>' if number else ""
    return f'<div class="equation">{equation_number}{mathematics}</div>'


def _inline(writer: Any, node: Any) -> None:
    from docutils import nodes

    writer.body.append(mathml(node.astext(), False, node))
    raise nodes.SkipNode


def _block(writer: Any, node: Any) -> None:
    from docutils import nodes

    writer.body.append(mathml(node.astext(), True, node))
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer "mathml"."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
