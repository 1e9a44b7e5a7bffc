"""Formulas as MathML, which browsers draw by themselves: no script, no network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docutils import nodes
from latex2mathml.converter import convert

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def visit_math(translator: Any, node: nodes.math) -> None:
    """Write a formula in a sentence."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def visit_math_block(translator: Any, node: nodes.math_block) -> None:
    """Write a formula in a line of its own, with its number if it has one."""
    text = node.astext().replace('{aligned}', '{align*}')
    translator.body.append(translator.starttag(node, 'div', CLASS='math-block'))
    translator.body.append(convert(text, display='block'))
    if node.get('number'):
        translator.body.append(f'<span class="eqno">({node["number"]})</span>')
    translator.body.append('</div>\n')

    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make this the renderer of formulas."""
    app.add_html_math_renderer('mathml', (visit_math, None), (visit_math_block, None))
    app.config.html_math_renderer = 'mathml'  # type: ignore[attr-defined]
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
