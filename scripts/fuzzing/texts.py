"""YAML and CSV that arrive: generated, damaged, in any encoding.

Each is read as a rubric, as points by hand, as parameters of nodes, as the QoS of a bag, and as a
roster.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from _bytes import TEXTS, text

from barc_sim.cli.yaml_files import MAX_YAML, from_yaml
from barc_sim.errors import UserError
from barc_sim.lab.files import BY_HAND, RUBRICS
from barc_sim.lab.grade import grade
from barc_sim.lab.grade.classroom import owner, read_roster
from barc_sim.ros.local.parameters import Arguments

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

clock = time.process_time
_MAX_LENGTH = 5_000_000  # characters: more than is read
_RUBRIC = grade.load_rubric(RUBRICS[0])
_YAML = (
    'title: "Lab"\nseed: 7\ncriteria: {model.x: 10, model.y: 5.5}\ntask_3:\n  relay.forward: 5\n',
    'comment: well driven\npoints:\n  model.x: 4.5 right, but late\n  model.y: 2\n',
    '/**:\n  ros__parameters:\n    kp: 30.0\n    names: [a, b]\n',
    '- history: 1\n  depth: 10\n  deadline:\n    sec: 2147483647\n    nsec: 4294967295\n',
)
_CSV = (
    'name,id,section\n"Chen, Li",123457,A\nZoë Ångström,zoe99,B\n',
    'Student,ID,SIS User ID,SIS Login ID,Section,Lab\n   Points Possible,,,,,\nAda,7,8,a,A,9\n',
    'First Name,Last Name,SID,Email\nChen,Li,5,chen@x.org\n',
)
_SCALARS = (
    *('1', '-1', '1e3', '.nan', 'inf', '0x' + 'f' * 300, '9' * 399, '1:30:00', '2020-01-01', '~'),
    *('"\\ud800"', '"\\0"', "'", '!!binary x', '!!float x', '!!python/name:os.system', '*a', '<<'),
    *(
        '!!timestamp 2020-99-99',
        '!!set {a}',
        '!!omap [a: b]',
        '!!int "0b"',
        '=',
        '@',
        '`',
        '%',
        '|',
    ),
)
#: Values with aliases in them.
_FORMS = ('[{}]', '{{x: [{}]}}', '{{<<: [{}], b: 1}}', '{{? [{}] : 1}}')
_ENCODINGS = ('utf-8', 'utf-8-sig', 'utf-16', 'utf-16-le', 'utf-32', 'cp1252', 'utf-7')
_FOLDERS = ('chen_li_123457_998878_lab-2.zip', 'ada', '', 'x' * 255, 'zoe99')


def original() -> None:
    """Do nothing: the texts are made as they are needed."""


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    match chance.randrange(6):
        case 0:
            content = _encode(chance.choice(_YAML), chance)
            return '.yaml', 'any bytes of YAML', text(content, chance)
        case 1:
            content = _encode(chance.choice(_CSV), chance)
            return '.csv', 'any bytes of CSV', text(content, chance)
        case 2:
            return '.yaml', 'aliases', _encode(_aliases(chance), chance)
        case 3:
            return '.yaml', 'nested YAML', _encode(_nested(chance), chance)
        case 4:
            return '.csv', 'generated CSV', _encode(_table(chance), chance)
    return '.yaml', 'values of YAML', _encode(_with_values(chance), chance)


def _encode(content: str, chance: Random) -> bytes:
    encoding = chance.choice(_ENCODINGS) if chance.random() < 0.3 else 'utf-8'  # noqa: PLR2004 (some)
    return content[:_MAX_LENGTH].encode(encoding, 'replace')


def _aliases(chance: Random) -> str:
    """Return lists and mappings that refer to one another, also to themselves."""
    lines = []
    count = chance.choice((1, 3, 20, 2_000))
    for k in range(count):
        aliases = [f'*a{chance.randrange(k + 1)}' for _ in range(chance.choice((1, 2, 10)))]
        value = chance.choice(_FORMS).format(', '.join(aliases))
        if k == 0 and chance.random() >= 0.5:  # noqa: PLR2004 (half)
            value = '{x: 1}'

        lines.append(f'a{k}: &a{k} {value}\n')
    return ''.join(lines) + chance.choice(('', 'criteria: *a0\n', 'points: *a0\n'))


def _nested(chance: Random) -> str:
    depth = chance.choice((2, 49, 51, 1_000, 60_000))
    form = chance.choice(('[', '{a: ', '- ', '? ', '[{', '"', '!a ', '&a '))

    if chance.random() < 0.3:  # noqa: PLR2004 (some)
        return '\n'.join(f'{" " * k}a:' for k in range(min(depth, 600)))
    return chance.choice(('', 'criteria: ', 'points: ')) + form * depth


def _with_values(chance: Random) -> str:
    lines = chance.choice(_YAML).splitlines()
    for _ in range(chance.choice((1, 1, 3))):
        at = chance.randrange(len(lines))
        key, _, _ = lines[at].partition(':')
        value = chance.choice((*_SCALARS, *TEXTS))
        lines[at] = f'{key}: {value}'
    return '\n'.join(lines)


def _table(chance: Random) -> str:
    """Return a roster with other delimiters, line ends, quotes, headers and numbers of cells."""
    rows = [line.split(',') for line in chance.choice(_CSV).splitlines()]

    for _ in range(chance.choice((0, 1, 3))):
        row = chance.choice(rows)
        cell = chance.choice((*TEXTS, '"', '""', '"a"b', 'a\rb', '\0', '=1+1', 'name', '  '))
        if row and chance.random() < 0.5:  # noqa: PLR2004 (half)
            row[chance.randrange(len(row))] = cell
        else:
            row += [cell] * chance.choice((1, 2, 3_000))

    size = sum(len(''.join(row)) for row in rows)
    if size < 1_000:  # noqa: PLR2004 (else too much)
        rows *= chance.choice((1, 1, 1, 5_000))

    delimiter = chance.choice((',', ';', '\t', '|'))
    end = chance.choice(('\n', '\r\n', '\r', ''))
    first = chance.choice(('', '', '', 'sep=;\n', '\n\n', '#', '\ufeff'))
    return first + ''.join(f'{delimiter.join(row)}{end}' for row in rows)


def _rubric(path: Path) -> None:
    rubric = grade.load_rubric(path)
    grade.nothing_entered(rubric).encode()


def _by_hand(path: Path) -> None:
    folder = path.with_suffix('.folder')
    folder.mkdir(exist_ok=True)
    (folder / BY_HAND).write_bytes(path.read_bytes())
    entered = grade.entered(folder, _RUBRIC)
    entered.comment.encode()


def _parameters(path: Path) -> None:
    try:
        arguments = Arguments(['--ros-args', '--params-file', str(path)])
    except RuntimeError as error:  # as rclpy's, of which `barc` makes a sentence
        raise UserError(str(error)) from None
    str(arguments.parameters).encode()


def _qos(path: Path) -> None:
    try:
        from_yaml(path.read_bytes().decode(errors='replace')[: MAX_YAML + 1])
    except ValueError as error:
        raise UserError(str(error)) from None


def _roster(path: Path) -> None:
    students = read_roster(path)
    for folder in _FOLDERS:
        owner(folder, students)


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    readers: list[Callable[[Path], object]] = [_rubric, _by_hand, _parameters, _qos, _roster]
    chance.shuffle(readers)
    return readers
