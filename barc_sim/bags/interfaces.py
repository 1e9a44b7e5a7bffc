"""The definitions of messages and services for readers, as `ros2 interface show` prints them."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.schemas import PRIMITIVES, share, shipped
from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator

_OURS = 'barc_interfaces'
_FIELD = re.compile(r'\s*([a-zA-Z]\w*(?:/\w+)?)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+')
_COMMENT = re.compile(r'\s*#.*')


def installed() -> dict[str, Path]:
    """Return the file of each message and service type, barc_sim's own and the installed ones."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    roots = [Path(prefix) / 'share' for prefix in prefixes if prefix]
    with suppress(LookupError):
        roots.append(share(_OURS).parent)
    found = dict(shipped())
    for root in roots:
        for kind in ('msg', 'srv'):
            for path in root.glob(f'*/{kind}/*.{kind}'):
                found[f'{path.parents[1].name}/{kind}/{path.stem}'] = path
    return dict(sorted(found.items()))


def find(name: str) -> str:
    """Return the full name of a type: of `ECU`, `barc_interfaces/ECU` or itself.

    Raises
    ------
    UserError
        if there is no such type, or there are several.

    Examples
    --------
    >>> find('ECU')
    'barc_interfaces/msg/ECU'
    """
    known = installed()
    if name in known:
        return name
    found = [full for full in known if name in _short_names(full)]
    ours = [full for full in found if full.startswith(f'{_OURS}/')]
    if len(ours or found) == 1:
        return (ours or found)[0]
    if found:
        raise UserError(f'{name!r} is the name of several types: name one of {", ".join(found)}')
    names = {short for full in known for short in (*_short_names(full), full)}
    same = [each for each in names if each.lower() == name.lower()]
    ends = f': did you mean {same[0]}?' if same else did_you_mean(name, names)
    own = ', '.join(_short_names(full)[0] for full in known if full.startswith(f'{_OURS}/'))
    raise UserError(f'there is no message or service {name!r}{ends or f": {_OURS} has {own}"}')


def _short_names(full: str) -> tuple[str, str]:
    package, _, base = full.split('/')
    return base, f'{package}/{base}'


def lines(name: str) -> Iterator[str]:
    """Yield the lines of the definition of `name`, with those of its fields' types indented.

    Comments are those of the type itself.

    Examples
    --------
    >>> for line in lines('barc_interfaces/msg/ECU'):
    ...     if line.startswith('float64'):
    ...         print(line)
    float64 motor            # [m/s^2] acceleration along the direction of travel
    float64 servo            # [rad] front steering angle, positive to the left
    """
    yield from _lines(installed(), name, 0)


def _lines(known: dict[str, Path], name: str, depth: int) -> Iterator[str]:
    for line in known[name].read_text(encoding='utf-8').splitlines():
        text = _COMMENT.sub('', line) if depth else line
        if text or not depth:
            yield ('\t' * depth + text).rstrip()
        field = _FIELD.match(_COMMENT.sub('', line))
        if field and field[1] not in PRIMITIVES:
            package, _, base = field[1].rpartition('/')
            nested = f'{package or name.partition("/")[0]}/msg/{base}'
            if nested in known:
                yield from _lines(known, nested, depth + 1)
