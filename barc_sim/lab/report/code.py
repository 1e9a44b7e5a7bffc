"""User code as HTML, with its lines numbered."""

from __future__ import annotations

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import PythonLexer

_FORMATTER = HtmlFormatter(nowrap=True)


def to_html(text: str) -> str:
    """Return `text`, which is Python, in colours; each line is an element of its own."""
    colored = highlight(text, PythonLexer(stripnl=False, ensurenl=False), _FORMATTER)
    lines = colored.removesuffix('\n').split('\n')
    return ''.join(f'<span class="line">{line}\n</span>' for line in lines)


def css() -> str:
    """Return the colours."""
    return str(_FORMATTER.get_style_defs('.code'))  # type: ignore[no-untyped-call]
