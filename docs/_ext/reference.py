"""Directives whose text is read from the package itself, so that no table can be wrong.

`barc-options`, `barc-messages`, `barc-topics`, `barc-services`, `barc-parameters` and `barc-room`
write the reference; `barc-figure` shows a figure that `figures.py` has drawn.
"""

from __future__ import annotations

import argparse
import re
import sys
from importlib import import_module
from itertools import groupby
from pathlib import Path
from pkgutil import walk_packages
from typing import TYPE_CHECKING, Any, ClassVar

import observed_nodes
import write_pages
from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from messages import MESSAGES, message
from sphinx.util.docutils import SphinxDirective

import barc_sim
from barc_sim.cli.parser import Parser
from barc_sim.commands import functions
from barc_sim.lab.hills.controller import PID_LAW
from barc_sim.lab.hills.model import BIKE
from barc_sim.simulation.log import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
#: Characters of a signature that is shown.
_LONGEST = 600


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


def table(heading: Sequence[str], rows: Iterable[Sequence[str]], widths: str) -> Iterator[str]:
    """Yield a table's text; the cells are reStructuredText."""
    yield from (
        '',
        '.. list-table::',
        '   :header-rows: 1',
        '   :class: fits',
        f'   :widths: {widths}',
        '',
    )
    for row in (heading, *rows):
        for i, cell in enumerate(row):
            first, *others = cell.split('\n')
            yield f'   {"* -" if i == 0 else "  -"} {first}'.rstrip()
            yield from (f'       {line}'.rstrip() for line in others)
    yield ''


def code(text: str) -> str:
    """Return `text` as literal."""
    return f'``{text}``' if text else ''


class Options(Generated):
    """Every option of a command, from its parser."""

    def lines(self) -> Iterator[str]:
        """Yield the usage and the options of the command, and of each verb that it has."""
        name = self.arguments[0]
        parser = Parser(prog=f'barc {name}')
        add_arguments, _ = functions(name)
        add_arguments(parser)
        self.env.note_dependency(add_arguments.__code__.co_filename)
        if parser.description:
            yield from (escaped(parser.description), '')
        yield from _usage(parser)
        yield from _described(parser)
        for verb, sub in verbs(parser):
            yield from ('', f'.. rubric:: barc {name} {verb}', '')
            if sub.description:
                yield from (escaped(sub.description), '')
            yield from _described(sub)
        if parser.epilog:
            yield from ('', escaped(parser.epilog), '')


def verbs(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield the parsers below a parser, by name."""
    for action in parser._actions:  # noqa: SLF001 (argparse has no other way)
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            yield from action.choices.items()


def _usage(parser: argparse.ArgumentParser) -> Iterator[str]:
    positional = [
        action.metavar or action.dest
        for action in parser._actions  # noqa: SLF001
        if not action.option_strings and action.help != argparse.SUPPRESS
    ]
    words = ' '.join(str(word) for word in positional)
    yield from ('.. code-block:: text', '', f'   {parser.prog} {words} [OPTION...]', '')


def _described(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield from (f'.. program:: {parser.prog}', '')
    for action in parser._actions:  # noqa: SLF001
        if action.help == argparse.SUPPRESS or isinstance(
            action,
            (argparse._HelpAction, argparse._SubParsersAction),  # noqa: SLF001
        ):
            continue
        if action.choices and not action.metavar:
            value = '|'.join(str(choice) for choice in action.choices)
        else:
            value = str(action.metavar or (action.dest.upper() if action.nargs != 0 else ''))
        if action.option_strings:
            value = '' if action.nargs == 0 else f' {value}'
            yield f'.. option:: {", ".join(f"{each}{value}" for each in action.option_strings)}'
        else:
            yield f'.. option:: {value}'
        yield ''
        text = (action.help or '').replace('%(default)s', str(action.default))
        yield from (f'   {escaped(text[:1].upper() + text[1:])}.', '')


def escaped(text: str) -> str:
    """Return `text` with reStructuredText's marks as they are, and options as literals."""
    text = re.sub(r'([*\\|])', r'\\\1', ' '.join(text.split()))
    text = re.sub(r'(?<=\w)_(?=\W|$)', r'\\_', text)
    return re.sub(r'(?<![\w`-])(--[a-z][\w-]*)', r'``\1``', text.replace('%%', '%'))


class Messages(Generated):
    """Every message of barc_interfaces, from its .msg file."""

    def lines(self) -> Iterator[str]:
        """Yield a title, what it is, and a table of the fields."""
        for path in sorted(MESSAGES.glob('*.msg')):
            self.env.note_dependency(str(path))
            about, fields = message(path.read_text(encoding='utf-8'))
            yield from (f'.. _message-{path.stem.lower()}:', '', path.stem, '-' * len(path.stem))
            yield from ('', escaped(about), '')
            rows = [(code(name), code(kind), escaped(text)) for kind, name, text in fields]
            yield from table(('field', 'type', 'meaning'), rows, '20 20 60')


def _kind(kind: str) -> str:
    package, name = kind.split('/')
    if package != 'barc_interfaces':
        return code(kind)
    return f':ref:`{name} <message-{name.lower()}>`'


def _about(kind: str) -> str:
    """Return what a message of barc_interfaces is; empty for others."""
    path = MESSAGES / f'{kind.split("/")[1]}.msg'
    return message(path.read_text(encoding='utf-8'))[0] if path.is_file() else ''


class Topics(Generated):
    """Every topic, from the nodes' endpoints; the meaning is that of the message or the name."""

    def lines(self) -> Iterator[str]:
        """Yield a table."""
        meanings = observed_nodes.meanings()
        rows = []
        for topic, (kind, publishers, subscribers) in observed_nodes.topics().items():
            ends = f'{", ".join(publishers) or "any"} → {", ".join(subscribers) or "any"}'
            about = escaped(meanings.get(topic) or _about(kind))
            rows.append(
                (f'{code(topic)}\n\n{_kind(kind)}', f'{about}\n\n.. rst-class:: ends\n\n{ends}')
            )
        yield from table(('topic and type', 'meaning; from → to'), rows, '40 60')


class Services(Generated):
    """Every service, from the nodes."""

    def lines(self) -> Iterator[str]:
        """Yield a table."""
        meanings = observed_nodes.meanings()
        rows = [
            (f'{code(name)}\n\n{_kind(kind)}', escaped(meanings.get(name, '')))
            for name, kind in observed_nodes.services().items()
        ]
        yield from table(('service and type', 'meaning'), rows, '40 60')


class Parameters(Generated):
    """Every parameter of every node, from the running nodes."""

    def lines(self) -> Iterator[str]:
        """Yield a title and a table for each node."""
        for node, rows in observed_nodes.parameters().items():
            yield from (f'.. _parameters-{node.replace("_", "-")}:', '', node, '-' * len(node), '')
            cells = [
                (
                    f'{code(name)}',
                    code(default),
                    f'{escaped(text)}\n\n.. rst-class:: ends\n\n{between}{fixed}',
                )
                for name, default, between, fixed, text in rows
            ]
            yield from table(('parameter', 'default', 'meaning; range'), cells, '30 15 55')


class Room(Generated):
    """The public names of every module of a room, from their docstrings."""

    required_arguments = 1
    optional_arguments = 0

    def lines(self) -> Iterator[str]:
        """Yield a title for each module, and what autodoc makes of it."""
        room = import_module(f'barc_sim.{self.arguments[0]}')
        found = walk_packages(getattr(room, '__path__', []), f'{room.__name__}.')
        for name in (room.__name__, *(module.name for module in found)):
            if any(part.startswith('_') or part == 'templates' for part in name.split('.')):
                continue
            short = name.removeprefix('barc_sim.')
            yield from ('', short, '~' * len(short), '', f'.. automodule:: {name}', '')


class Columns(Generated):
    """Every column of a log, from its declaration."""

    def lines(self) -> Iterator[str]:
        """Yield a table."""
        rows = [
            (code(name), column.unit, code(column.topic), escaped(column.meaning))
            for name, column in COLUMNS.items()
        ]
        yield from table(('column', 'unit', 'topic', 'meaning'), rows, '20 10 20 50')


class Mistakes(Generated):
    """Every sentence of the tables of mistakes in `lab/hills`, by what it is about."""

    def lines(self) -> Iterator[str]:
        """Yield a title and a list for each group."""
        mistakes = (*BIKE.mistakes, *PID_LAW.mistakes)
        for title, group in groupby(mistakes, key=lambda mistake: mistake.topic):
            yield from (title, '-' * len(title), '')
            sentences = (re.sub(r'(last|over) \d+', r'\1 n', each.sentence) for each in group)
            for sentence in dict.fromkeys(sentences):
                yield f'- {escaped(sentence)}'
            yield ''


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
            parsed = nodes.Element()
            self.state.nested_parse(self.content, self.content_offset, parsed)
            caption += parsed[0].children
            figure += caption
        return [figure]


def _prepare(_: Sphinx) -> None:
    write_pages.write(ROOT / 'docs')
    sys.path.insert(0, str(ROOT / 'docs'))
    import_module('figures').draw_missing()


def _clean(_: Sphinx, what: str, *about: Any) -> None:
    """Let |x| in a docstring be the amount of x, and a colon a colon; drop namedtuple's text."""
    lines = about[-1]
    if lines and lines[0].startswith('Alias for field number'):
        lines.clear()
    if what in {'attribute', 'data'} and lines:
        lines[0] = lines[0].replace(': ', r'\: ', 1)  # else napoleon reads a type before it
    for i, line in enumerate(lines):
        parts = re.split(r'(`+[^`]*`+)', line)
        lines[i] = ''.join(
            part if part.startswith('`') else re.sub(r'\|(?=[^|]*\|)|(?<=\S)\|', r'\|', part)
            for part in parts
        )


def _shorten(_: Sphinx, *about: Any) -> tuple[str, str | None] | None:
    """Leave out a signature that nobody would read; the fields follow it."""
    *_, signature, returned = about
    return ('(...)', returned) if signature and len(signature) > _LONGEST else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directives, and first draw the figures and write the pages that follow from lists."""
    for name, directive in {
        'barc-columns': Columns,
        'barc-exports': Exports,
        'barc-figure': Figure,
        'barc-messages': Messages,
        'barc-mistakes': Mistakes,
        'barc-options': Options,
        'barc-parameters': Parameters,
        'barc-room': Room,
        'barc-services': Services,
        'barc-topics': Topics,
    }.items():
        app.add_directive(name, directive)
    app.connect('builder-inited', _prepare)
    app.connect('autodoc-process-docstring', _clean, priority=400)  # before napoleon
    app.connect('autodoc-process-signature', _shorten)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
