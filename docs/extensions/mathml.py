"""Formulas as MathML, which browsers draw by themselves: Sphinx's own renderers need a network or LaTeX."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

_logger = logging.getLogger(__name__)


def _inline(writer: Any, node: nodes.Element) -> None:
    writer.body.append(_mathml(node))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.Element) -> None:
    formula = _mathml(node).replace('<math ', '<math display="block" ', 1)
    writer.body.append(f'<div class="math">{formula}</div>\n')
    raise nodes.SkipNode


def _mathml(node: nodes.Element) -> str:
    try:
        return tex2mathml(node.astext())
    except (ValueError, SyntaxError) as error:   # the latter in docutils before 0.22
        _logger.warning('formula %r: %s', node.astext(), error, location=node)
        return ''


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer('mathml', (_inline, None), (_block, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
