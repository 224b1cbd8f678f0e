"""Formulas as MathML, which browsers show by themselves: no script, no network."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)


def _written(node: Any, block: bool) -> str:
    try:
        return str(tex2mathml(node.astext(), as_block=block))
    except MathError as error:
        logger.warning("formula: %s", error, location=node)
        return ""


def inline(translator: Any, node: Any) -> None:
    translator.body.append(_written(node, False))
    raise nodes.SkipNode


def block(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="math">{_written(node, True)}</div>\n')
    raise nodes.SkipNode


def setup_math(app: Any) -> None:
    """Register the renderer that html_math_renderer names."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
