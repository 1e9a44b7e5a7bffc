"""Writes the parts of the reference that follow from the program, into the Markdown pages.

`python docs/_ext/write_pages.py` renews the text between `<!-- generated: NAME -->` and
`<!-- end -->`; a test compares. So the pages read well where they are not built, too.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
import textwrap
from importlib import import_module
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
from barc_sim.lab.grade.grade import load_rubric
from barc_sim.lab.judge import FACTOR_LOSS, SIGN_LOSS, UNRELATED
from barc_sim.lab.labs import hills, identify, lane, raceline
from barc_sim.lab.labs.lane import CLASS as LANE_CLASS
from barc_sim.simulation.log import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from types import ModuleType

    from barc_sim.lab.judge import Functions
    from barc_sim.lab.law import Law, Mistake

DOCS = Path(__file__).parents[1]
#: In the order in which they import one another.
ROOMS = (
    'errors', 'cli', 'parallel', 'interfaces', 'vehicle', 'control', 'simulation', 'tuning', 'bags',
    'figures', 'learning', 'page', 'lab', 'ros', 'nodes', 'runs', 'commands',
)  # fmt: skip
#: The files of students, and the laws that are judged in them.
_LAWS: tuple[tuple[str, Law], ...] = (
    ('bike_model.py', hills.BIKE),
    ('controller.py', hills.PID_LAW),
    ('lane.py', lane.LAW),
    ('lane.py', LANE_CLASS),
    ('raceline.py', raceline.LAW),
    ('identify.py', identify.LAW),
)
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
    return re.sub(literal, _as_code, text)


def _as_code(match: re.Match[str]) -> str:
    return code(match[0].replace('\\', '').strip('`'))


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
            for verb, subparser in _subparsers(parser).items():
                yield from (f'#### barc {name} {verb}', '', plain(subparser.description or ''))
                yield from _options(subparser)
            if parser.epilog:
                yield from (plain(parser.epilog), '')


def _subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of a command's verbs."""
    for action in parser._actions:  # noqa: SLF001 (argparse has no other way)
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            return action.choices
    return {}


def _options(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield a table of the options, or an empty line if there are none."""
    helps = (argparse._HelpAction, argparse._SubParsersAction)  # noqa: SLF001
    rows = []
    for action in parser._actions:  # noqa: SLF001
        if action.help == argparse.SUPPRESS or isinstance(action, helps):
            continue

        words = [', '.join(action.option_strings), _value(action)]
        usage = ' '.join(word for word in words if word)
        rows.append((code(usage), plain((action.help or '') % vars(action))))

    if rows:
        return table(('option', 'meaning; default'), rows)
    return iter([''])


def _value(action: argparse.Action) -> str:
    """Return the placeholder of an option's value; '' for an option without one."""
    if action.nargs == 0:
        return ''
    if isinstance(action.metavar, tuple):
        return ' '.join(action.metavar)
    if action.metavar:
        return action.metavar
    if action.choices:
        return '\\|'.join(str(choice) for choice in action.choices)
    return action.dest.upper()


def fields() -> Iterator[str]:
    """Yield a section for each message of barc_interfaces, from its .msg file."""
    for path in sorted(messages.MESSAGES.glob('*.msg')):
        about, declarations = messages.message(path.read_text(encoding='utf-8'))
        yield from (f'## {path.stem}', '', plain(about))
        rows = (
            (code(field.name), code(field.kind), plain(field.comment)) for field in declarations
        )
        yield from table(('field', 'type', 'meaning'), rows)


def _type(kind: str) -> str:
    """Return the name of a type, such as `std_msgs/msg/Float64`; ours are links."""
    package, _, name = kind.split('/')
    if package == 'barc_interfaces':
        return f'[{name}](messages.md#{name.lower()})'
    return code(f'{package}/{name}')


def topics() -> Iterator[str]:
    """Yield a table of the topics, from the table of nodes."""
    meanings = _meanings(topic_names)
    rows = []
    for topic, message_type in sorted(MESSAGE_TYPES.items(), key=lambda row: row[0].lstrip('/')):
        meaning = meanings.get(topic) or _about_message(message_type)
        publishers = [name for name, node in NODES.items() if topic in node.publishes]
        subscribers = [name for name, node in NODES.items() if topic in node.subscribes]
        rows.append(
            (
                code(topic),
                _type(message_type),
                plain(meaning),
                ', '.join(sorted(publishers)) or 'any',
                ', '.join(sorted(subscribers)) or 'any',
            )
        )
    return table(('topic', 'type', 'meaning', 'from', 'to'), rows)


def _about_message(message_type: str) -> str:
    """Return the comment at the top of one of our messages; '' for another's."""
    path = messages.MESSAGES / f'{message_type.rpartition("/")[2]}.msg'
    if not path.is_file():
        return ''
    about, _ = messages.message(path.read_text(encoding='utf-8'))
    return about


def services() -> Iterator[str]:
    """Yield a table of the services."""
    meanings = _meanings(service_names)
    rows = []
    for service, service_type in sorted(SERVICE_TYPES.items()):
        rows.append((code(service), _type(service_type), plain(meanings[service])))
    return table(('service', 'type', 'meaning'), rows)


def _meanings(module: ModuleType) -> dict[str, str]:
    """Return the comment at each constant of a module, by the constant's value."""
    text = Path(module.__file__ or '').read_text(encoding='utf-8')
    comments = re.findall(
        r"^(?:#: (.*)\n)?([A-Z_]+) = '[\w./]+'(?:  #: (.*))?$", text, re.MULTILINE
    )

    meanings = {}
    for before, name, behind in comments:
        if before or behind:
            meanings[getattr(module, name)] = before or behind
    return meanings


def parameters() -> Iterator[str]:
    """Yield a table for each node, from its parameters."""
    import observed_nodes  # noqa: PLC0415 (needs ROS)

    for node, parameters_of_node in observed_nodes.parameters().items():
        yield from (f'## {node}', '')
        rows = (
            (code(row.name), code(row.default), plain(row.meaning), row.range)
            for row in parameters_of_node
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
    """Yield every sentence of the tables of mistakes, by file and what it is about, with points."""
    for title, points_by_sentence in _points_by_title().items():
        yield from (f'## {title}', '')
        for sentence, points in points_by_sentence.items():
            yield f'- {plain(sentence)}{_cost(points)}'
        yield ''


def _points_by_title() -> dict[str, dict[str, list[float]]]:
    """Return what each sentence of the laws costs, in their order, with n for measured numbers."""
    by_title: dict[str, dict[str, list[float]]] = {}
    for file, law in _LAWS:
        for mistake in law.mistakes:
            points_by_sentence = by_title.setdefault(f'`{file}`: {mistake.topic.lower()}', {})
            sentence = re.sub(r'\b(?<=last |over )\d+|\{.*?\}', 'n', mistake.sentence)
            points_by_sentence.setdefault(sentence, []).extend(_points_lost(law, mistake))
    return by_title


def _points_lost(law: Law, mistake: Mistake) -> list[float]:
    """Return what a mistake alone costs with the usual rubric; empty if the laps decide it."""
    judge_of: dict[int, tuple[Functions, str]] = {
        id(hills.BIKE): (hills.FUNCTIONS, 'lab'),
        id(lane.LAW): (lane.FUNCTIONS, 'lane'),
        id(raceline.LAW): (raceline.FUNCTIONS, 'raceline'),
        id(identify.LAW): (identify.FUNCTIONS, 'identify'),
    }
    if law is hills.PID_LAW:
        rubric = load_rubric('lab')
        seed = rubric.settings.seed
        trials = [term.trial_with(mistake, seed) for term in hills.TERMS]
        weights = {term.name: rubric.points[term.criterion] for term in hills.TERMS}
        scores = hills.TERM_JUDGE.scores(trials, weights)
    elif id(law) in judge_of:
        judge, name = judge_of[id(law)]
        rubric = load_rubric(name)
        trials = judge.trials_with(mistake, rubric.settings.seed)
        weights = {result: rubric.points[key] for result, key in judge.criteria.items()}
        scores = judge.scores(trials, weights)
    else:
        return []
    return [sum(weights[name] * (1.0 - result.score) for name, result in scores.items())]


def _cost(points: Sequence[float]) -> str:
    """Return what one sentence costs, from the least to the most, in brackets."""
    if not points:
        return ''
    least = f'{min(points):.3g}'
    most = f'{max(points):.3g}'
    return f' ({least} points)' if least == most else f' ({least} to {most} points)'


def losses() -> Iterator[str]:
    """Yield how much of an equation a mistake costs, with examples of the model's equations."""
    rubric = load_rubric('lab')
    least = f'{hills.FUNCTIONS.min_loss:.0%}'
    factor = f'{FACTOR_LOSS:.0%}'
    sign = f'{SIGN_LOSS:.0%}'
    term = f'{hills.TERM_JUDGE.min_loss:.0%}'
    function = f'{raceline.FUNCTIONS.min_loss:.0%}'
    text = (
        f'- **By how wrong an equation is.** A wrong result costs at least {least} of its '
        f'equation. A wrong factor of the whole change costs up to {factor}, and a wrong sign of '
        f'it {sign}. A result that is missing, or whose error is {UNRELATED:.0%} of its size or '
        'more, costs all of it. Where a single term is wrong, it depends on how many of the test '
        f'cases show it. A known mistake costs at most {sign}. A wrong term of the PID costs at '
        f'least {term} of it, a wrong function of Lab 4 at least {function}.'
    )
    yield from textwrap.wrap(text.replace('%', ' %'), 110, subsequent_indent='  ')
    yield ''
    yield f'  Examples, for the speed with its {rubric.points["model.v"]:g} points:'
    rows = []
    for beginning in _EXAMPLES:
        mistake = next(one for one in hills.BIKE.mistakes if one.sentence.startswith(beginning))
        (lost,) = _points_lost(hills.BIKE, mistake)
        percent = 100.0 * lost / rubric.points['model.v']
        rows.append((plain(mistake.sentence), f'{lost:.3g}', f'{percent:.0f} %'))
    for line in table(('mistake', 'points', 'of the equation'), rows):
        yield f'  {line}'.rstrip()


#: Mistakes in the speed, by the beginning of their sentence.
_EXAMPLES = (
    'g is 9.81',
    'air drag is missing',
    'gravity speeds the car up uphill',
    'gravity is missing',
    'F_ext has the wrong sign',
    'v falls, but must grow',
    'v does not change',
)


def exports() -> Iterator[str]:
    """Yield a table of what `import barc_sim` offers, by the first line of each docstring."""
    rows = ((code(name), plain(_about(getattr(barc_sim, name)))) for name in barc_sim.__all__)
    return table(('name', 'what'), rows)


def rooms() -> Iterator[str]:
    """Yield a table of the rooms."""
    names = [f'barc_sim.{name}' for name in ROOMS]
    rows = ((code(name), plain(_about(import_module(name)))) for name in names)
    return table(('room', 'what'), rows)


def _about(thing: object) -> str:
    return (inspect.getdoc(thing) or '').partition('\n\n')[0]


_WRITERS = (
    commands, fields, topics, services, parameters, columns, mistakes, losses, exports, rooms,
)  # fmt: skip
#: The functions that write the parts, by the names of these.
PARTS: dict[str, Callable[[], Iterator[str]]] = {write.__name__: write for write in _WRITERS}


def pages() -> Iterator[Path]:
    """Yield the pages with generated parts."""
    for path in sorted(DOCS.rglob('*.md')):
        if '_build' not in path.parts and '<!-- generated: ' in path.read_text(encoding='utf-8'):
            yield path


def filled(text: str) -> str:
    """Return the text of a page with its generated parts as they have to be."""
    return _PART.sub(_filled_part, text)


def _filled_part(match: re.Match[str]) -> str:
    begin, name, end = match.groups()
    lines = '\n'.join(PARTS[name]()).strip('\n')
    lines = re.sub(r'\n{3,}', '\n\n', lines)
    return f'{begin}\n{lines}\n\n{end}'


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
