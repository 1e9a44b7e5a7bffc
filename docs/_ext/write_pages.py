"""Writes the parts of the reference that follow from the program, into the Markdown pages.

`python docs/_ext/write_pages.py` renews the text between `<!-- generated: NAME -->` and
`<!-- end -->`; a test compares. So the pages read well where they are not built, too.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import messages

import barc_sim
from barc_sim.__main__ import functions
from barc_sim.cli.parser import Parser
from barc_sim.commands import GROUPS
from barc_sim.interfaces import services as service_names
from barc_sim.interfaces import topics as topic_names
from barc_sim.interfaces.nodes import NODES
from barc_sim.interfaces.services import SERVICE_TYPES
from barc_sim.interfaces.topics import MESSAGE_TYPES
from barc_sim.lab.labs.hills import BIKE, PID_LAW
from barc_sim.lab.labs.identify import LAW as IDENTIFY
from barc_sim.lab.labs.lane import CLASS as LANE_CLASS
from barc_sim.lab.labs.lane import LAW as LANE
from barc_sim.lab.labs.raceline import LAW as RACELINE
from barc_sim.simulation.log import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from types import ModuleType

    from barc_sim.lab.law import Law

DOCS = Path(__file__).parents[1]
#: In the order in which they import one another.
ROOMS = (
    'errors', 'cli', 'interfaces', 'vehicle', 'control', 'simulation', 'tuning', 'learning', 'bags',
    'figures', 'page', 'lab', 'ros', 'nodes', 'runs', 'commands',
)  # fmt: skip
_PART = re.compile(r'(<!-- generated: (\w+) -->\n).*?(<!-- end -->)', re.DOTALL)


def code(text: str) -> str:
    """Return `text` as literal."""
    return f'`{text}`' if text else ''


def plain(text: str) -> str:
    """Return `text` with Markdown's marks as they are, and options as literals."""
    text = text.replace('%%', '%').replace(f'{DOCS.parent}/', '')  # of this checkout
    text = re.sub(r'([*_<|\[$])', r'\\\1', ' '.join(text.split()))
    # What is a literal already, or an option.
    literal = r'`[^`]*`|(?<![\w-])--[a-z][\w\\-]*'
    return re.sub(literal, lambda found: code(found[0].replace('\\', '').strip('`')), text)


def table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table; the cells are Markdown."""
    yield from ('', f'| {" | ".join(heading)} |', '|---' * len(heading) + '|')
    for row in rows:
        yield f'| {" | ".join(row)} |'
    yield ''


def commands() -> Iterator[str]:
    """Yield a section for each command, from its parser."""
    for group, names in GROUPS.items():
        yield from (f'## {group[:1].upper()}{group[1:]}', '')
        for name in names:
            parser = Parser(prog=f'barc {name}')
            add_arguments, _ = functions(name)
            add_arguments(parser)
            yield from (f'### barc {name}', '', plain(parser.description or ''))
            yield from _options(parser)
            for action in parser._actions:  # noqa: SLF001 (argparse has no other way)
                if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
                    for verb, sub in action.choices.items():
                        yield from (f'#### barc {name} {verb}', '', plain(sub.description or ''))
                        yield from _options(sub)
            if parser.epilog:
                yield from (plain(parser.epilog), '')


def _options(parser: argparse.ArgumentParser) -> Iterator[str]:
    helps = (argparse._HelpAction, argparse._SubParsersAction)  # noqa: SLF001
    rows = []
    for action in parser._actions:  # noqa: SLF001
        if action.help == argparse.SUPPRESS or isinstance(action, helps):
            continue
        value = action.metavar or (action.dest.upper() if action.nargs != 0 else '')
        value = value if isinstance(value, str) else ' '.join(value)
        if action.choices and not action.metavar:
            value = '\\|'.join(str(choice) for choice in action.choices)
        names = ', '.join(action.option_strings)
        shown = f'{names} {"" if action.nargs == 0 else value}' if names else value
        rows.append((code(shown.strip()), plain((action.help or '') % vars(action))))
    return table(('option', 'meaning; default'), rows) if rows else iter([''])


def fields() -> Iterator[str]:
    """Yield a section for each message of barc_interfaces, from its .msg file."""
    for path in sorted(messages.MESSAGES.glob('*.msg')):
        about, found = messages.message(path.read_text(encoding='utf-8'))
        yield from (f'## {path.stem}', '', plain(about))
        rows = ((code(name), code(kind), plain(text)) for kind, name, text in found)
        yield from table(('field', 'type', 'meaning'), rows)


def _kind(kind: str) -> str:
    package, name = kind.split('/')
    return f'[{name}](messages.md#{name.lower()})' if package == 'barc_interfaces' else code(kind)


def topics() -> Iterator[str]:
    """Yield a table of the topics, from the table of nodes."""
    meanings = _meanings(topic_names)
    rows = []
    for topic, message_type in sorted(MESSAGE_TYPES.items(), key=lambda row: row[0].lstrip('/')):
        package, _, name = message_type.split('/')
        path = messages.MESSAGES / f'{name}.msg'
        about = messages.message(path.read_text(encoding='utf-8'))[0] if path.is_file() else ''
        publishers = [name for name, node in NODES.items() if topic in node.publishes]
        subscribers = [name for name, node in NODES.items() if topic in node.subscribes]
        ends = (', '.join(sorted(ends)) or 'any' for ends in (publishers, subscribers))
        meaning = plain(meanings.get(topic) or about)
        rows.append((code(topic), _kind(f'{package}/{name}'), meaning, *ends))
    return table(('topic', 'type', 'meaning', 'from', 'to'), rows)


def services() -> Iterator[str]:
    """Yield a table of the services."""
    meanings = _meanings(service_names)
    rows = []
    for service, service_type in sorted(SERVICE_TYPES.items()):
        package, _, name = service_type.split('/')
        rows.append((code(service), _kind(f'{package}/{name}'), plain(meanings[service])))
    return table(('service', 'type', 'meaning'), rows)


def _meanings(module: ModuleType) -> dict[str, str]:
    """Return the comment at each constant of a module, by the constant's value."""
    text = Path(module.__file__ or '').read_text(encoding='utf-8')
    comments = re.findall(
        r"^(?:#: (.*)\n)?([A-Z_]+) = '[\w./]+'(?:  #: (.*))?$", text, re.MULTILINE
    )
    return {
        getattr(module, name): before or behind
        for before, name, behind in comments
        if before or behind
    }


def parameters() -> Iterator[str]:
    """Yield a table for each node, from its parameters."""
    import observed_nodes  # noqa: PLC0415 (needs ROS)

    for node, found in observed_nodes.parameters().items():
        yield from (f'## {node}', '')
        rows = (
            (code(name), code(default), plain(text), f'{between}{fixed}')
            for name, default, between, fixed, text in found
        )
        yield from table(('parameter', 'default', 'meaning', 'range'), rows)


def columns() -> Iterator[str]:
    """Yield a table of the columns of a log."""
    rows = (
        (code(name), plain(column.unit), code(column.topic), plain(column.meaning))
        for name, column in COLUMNS.items()
    )
    return table(('column', 'unit', 'topic', 'meaning'), rows)


def mistakes() -> Iterator[str]:
    """Yield every sentence of the tables of mistakes, by file and what it is about."""

    def of(file: str, law: Law) -> list[tuple[str, str]]:
        return [(f'`{file}`: {each.topic.lower()}', each.sentence) for each in law.mistakes]

    files = 'bike_model.py', 'controller.py', 'lane.py', 'lane.py', 'raceline.py', 'identify.py'
    laws = BIKE, PID_LAW, LANE, LANE_CLASS, RACELINE, IDENTIFY
    every = [each for file, law in zip(files, laws, strict=True) for each in of(file, law)]
    for title, group in groupby(every, key=lambda each: each[0]):
        yield from (f'## {title}', '')
        # Measured numbers stand for n.
        sentences = (re.sub(r'\b(?<=last |over )\d+|\{.*?\}', 'n', each) for _, each in group)
        yield from (f'- {plain(sentence)}' for sentence in dict.fromkeys(sentences))
        yield ''


def exports() -> Iterator[str]:
    """Yield a table of what `import barc_sim` offers, by the first line of each docstring."""
    rows = ((code(name), plain(_about(getattr(barc_sim, name)))) for name in barc_sim.__all__)
    return table(('name', 'what'), rows)


def rooms() -> Iterator[str]:
    """Yield a table of the rooms."""
    names = (f'barc_sim.{name}' for name in ROOMS)
    return table(
        ('room', 'what'), ((code(name), plain(_about(import_module(name)))) for name in names)
    )


def _about(thing: object) -> str:
    return (inspect.getdoc(thing) or '').partition('\n\n')[0]


_WRITERS = (commands, fields, topics, services, parameters, columns, mistakes, exports, rooms)
PARTS: dict[str, Callable[[], Iterator[str]]] = {each.__name__: each for each in _WRITERS}


def pages() -> Iterator[Path]:
    """Yield the pages with generated parts."""
    for path in sorted(DOCS.rglob('*.md')):
        if '_build' not in path.parts and '<!-- generated: ' in path.read_text(encoding='utf-8'):
            yield path


def filled(text: str) -> str:
    """Return the text of a page with its generated parts as they have to be."""

    def part(found: re.Match[str]) -> str:
        lines = '\n'.join(PARTS[found[2]]()).strip('\n')
        lines = re.sub(r'\n{3,}', '\n\n', lines)
        return f'{found[1]}\n{lines}\n\n{found[3]}'

    return _PART.sub(part, text)


def write_rooms(folder: Path) -> None:
    """Write the pages of the rooms and of the exports for autodoc, where they have changed."""
    texts = {'names': ('What import barc_sim offers', '.. barc-exports::')}
    texts |= {name: (f'barc_sim.{name}', f'.. barc-room:: {name}') for name in ROOMS}
    for name, (title, directive) in texts.items():
        target = folder / 'reference' / 'api' / f'{name}.rst'
        search = '' if name == 'names' else ':nosearch:\n\n'  # the rooms are for developers
        text = f'{search}{title}\n{"=" * len(title)}\n\n{directive}\n'
        if not target.is_file() or target.read_text(encoding='utf-8') != text:
            target.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    for page in pages():
        page.write_text(filled(page.read_text(encoding='utf-8')), encoding='utf-8')
        sys.stdout.write(f'{page}\n')
