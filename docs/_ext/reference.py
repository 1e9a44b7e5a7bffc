"""Directives: `barc-exports` and `barc-room` are written by autodoc; `barc-figure` shows a figure.

The tables of the reference are Markdown in the repository: see `write_pages.py`.
"""

from __future__ import annotations

import re
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import TYPE_CHECKING, Any, ClassVar

import write_pages
from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from sphinx import addnodes
from sphinx.util.docutils import SphinxDirective

import barc_sim

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
#: Modules for users; `import barc_sim` offers what others have for them.
PUBLIC = ('bags.reader', 'nodes', 'ros.executor.executor')
#: Characters of a signature that is printed in full.
_MAX_SIGNATURE = 600


class Generated(SphinxDirective):
    """A directive that parses the reStructuredText of `lines`."""

    has_content = False
    optional_arguments = 1

    def lines(self) -> Iterable[str]:
        """Return the text."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Parse it where the directive stands."""
        container = nodes.section()
        container.document = self.state.document
        text = StringList([*self.lines(), ''], source=self.get_source_info()[0])
        self.state.nested_parse(text, self.content_offset, container, match_titles=True)
        return container.children


class Room(Generated):
    """The public names of every module of a room, from their docstrings."""

    required_arguments = 1
    optional_arguments = 0

    def lines(self) -> Iterator[str]:
        """Yield a title for each module, and what autodoc makes of it."""
        room = import_module(f'barc_sim.{self.arguments[0]}')
        modules = walk_packages(getattr(room, '__path__', []), f'{room.__name__}.')
        for name in (room.__name__, *(module.name for module in modules)):
            if any(part.startswith('_') or part == 'templates' for part in name.split('.')):
                continue

            short_name = name.removeprefix('barc_sim.')
            yield from ('', short_name, '~' * len(short_name), '')
            yield f'.. automodule:: {name}'
            if not _is_public(short_name):
                yield '   :no-index:'  # neither in the index nor in the search for names
            yield ''


def _is_public(module: str) -> bool:
    return any(module == public or module.startswith(f'{public}.') for public in PUBLIC)


class Exports(Generated):
    """Every name that `import barc_sim` offers, from its docstring."""

    def lines(self) -> Iterator[str]:
        """Yield what autodoc makes of each."""
        for name in barc_sim.__all__:
            kind = 'class' if isinstance(getattr(barc_sim, name), type) else 'function'
            yield from (f'.. auto{kind}:: barc_sim.{name}', '')


class Figure(SphinxDirective):
    """A figure that `figures.py` has drawn, light and dark, with what it shows as its text."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {'alt': directives.unchanged_required}

    def run(self) -> list[nodes.Node]:
        """Return both images, of which the theme shows one, and the caption."""
        figure = nodes.figure('', classes=['figure-pair'])
        depth = self.env.docname.count('/')
        for look in ('light', 'dark'):
            name = f'{self.arguments[0]}-{look}.svg'
            if not (ROOT / 'docs' / '_figures' / name).is_file():
                raise self.error(f'figures.py draws no {name}')
            source = f'{"../" * depth}_static/{name}'
            html = f'<img class="only-{look}" src="{source}" alt="{self.options["alt"]}"/>'
            figure += nodes.raw('', html, format='html')

        if self.content:
            caption = nodes.caption()
            element = nodes.Element()
            self.state.nested_parse(self.content, self.content_offset, element)
            caption += element[0].children
            figure += caption
        return [figure]


def _prepare(_: Sphinx) -> None:
    write_pages.write_rooms(ROOT / 'docs')
    sys.path.insert(0, str(ROOT / 'docs'))
    import_module('figures').draw_missing()


def _clean(
    _: Sphinx, kind: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Let |x| in a docstring be the amount of x, and a colon a colon; drop namedtuple's text."""
    del name, thing, options
    if lines and lines[0].startswith('Alias for field number'):
        lines.clear()
    if kind in {'attribute', 'data'} and lines:
        lines[0] = lines[0].replace(': ', r'\: ', 1)  # else napoleon reads a type before it
    for number, line in enumerate(lines):
        lines[number] = _with_bars(line)


def _with_bars(line: str) -> str:
    """Return a line whose bars are bars, and not marks of substitutions."""
    parts = re.split(r'(`+[^`]*`+)', line)
    for number, part in enumerate(parts):
        if not part.startswith('`'):
            parts[number] = re.sub(r'\|(?=[^|]*\|)|(?<=\S)\|', r'\|', part)
    return ''.join(parts)


def _shorten(
    _: Sphinx,
    kind: str,
    name: str,
    thing: object,
    options: object,
    signature: str | None,
    annotation: str | None,
) -> tuple[str, str | None] | None:
    """Leave out a signature that nobody would read; the fields follow it."""
    del kind, name, thing, options
    if signature and len(signature) > _MAX_SIGNATURE:
        return '(...)', annotation
    return None


def _link_words(app: Sphinx, doctree: nodes.document) -> None:
    """Link the first use of each of the glossary's words on a page, on the built pages."""
    page = app.env.docname
    if page.startswith(('reference/', 'notebooks/', 'changelog')):
        return

    words = _glossary()
    if page.startswith('instructors/'):
        words.discard('grade')  # a score there, not a slope
    for paragraph in doctree.findall(nodes.paragraph):
        for text in [child for child in paragraph.children if isinstance(child, nodes.Text)]:
            match = _first_word(words, text)
            if match:
                words.remove(match[0])
                paragraph.replace(text, _with_link(text, match, page))


def _glossary() -> set[str]:
    text = (ROOT / 'docs' / 'reference' / 'glossary.md').read_text(encoding='utf-8')
    return set(re.findall(r'^([a-z][\w -]+)\n  ', text, re.MULTILINE))


def _first_word(words: set[str], text: str) -> re.Match[str] | None:
    """Find the first of the words in a text; a longer word before a shorter one."""
    if not words:
        return None
    alternatives = '|'.join(sorted(words, key=len, reverse=True))
    return re.search(rf'\b({alternatives})\b', text)


def _with_link(text: str, match: re.Match[str], page: str) -> list[nodes.Node]:
    """Return a text whose matched word is a link to the glossary."""
    word = match[0]
    link = addnodes.pending_xref(
        '',
        nodes.inline('', word),
        refdomain='std',
        reftype='term',
        reftarget=word,
        refdoc=page,
        refexplicit=True,
    )
    return [nodes.Text(text[: match.start()]), link, nodes.Text(text[match.end() :])]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directives, and first draw the figures and write the pages that follow from lists."""
    app.add_directive('barc-exports', Exports)
    app.add_directive('barc-figure', Figure)
    app.add_directive('barc-room', Room)

    app.connect('builder-inited', _prepare)
    app.connect('autodoc-process-docstring', _clean, priority=400)  # before napoleon
    app.connect('autodoc-process-signature', _shorten)
    app.connect('doctree-read', _link_words)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
