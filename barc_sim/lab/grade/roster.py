"""The students of a class, from a CSV file, and which of them handed in a folder."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_MAX_BYTES = 4 << 20
#: The headers of a column, in lower case: those of Canvas and of Gradescope among them.
_HEADERS = {
    'name': ('name', 'student', 'full name'),
    'first': ('first name', 'given name'),
    'last': ('last name', 'surname', 'family name'),
    'id': ('id', 'sid', 'student id', 'sis user id'),
    'login': ('sis login id', 'login', 'email', 'e-mail'),
    'section': ('section', 'sections'),
}


@dataclass(frozen=True, eq=False)
class Student:
    """A row of the roster."""

    name: str
    id: str
    section: str
    login: str  #: or address
    ids: frozenset[str]  #: all that can stand in the name of a folder, as words
    columns: dict[str, str]  #: of the file, by header


def read(path: Path) -> list[Student]:
    """Return the students of a CSV file with the columns name, id and section, or a UserError.

    An export of the gradebook of Canvas, and a roster of Gradescope, are such files.
    """
    try:
        text = read_regular(path, _MAX_BYTES).decode('utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise UserError(f'the roster {str(path)!r} cannot be read: {reason}') from None
    rows = csv.DictReader(io.StringIO(text))
    headers = {header.strip().lower(): header for header in rows.fieldnames or () if header}
    if not {'name', 'student', 'full name', 'last name'} & headers.keys():
        raise UserError(
            f'the roster {str(path)!r} has no column name: expected a first line such as '
            'name,id,section'
        )
    return [student for row in rows if (student := _student(row, headers))]


def _student(row: dict[str, str], headers: dict[str, str]) -> Student | None:
    found = {
        field: next((row[headers[h]] or '' for h in known if h in headers), '').strip()
        for field, known in _HEADERS.items()
    }
    name = found['name'] or f'{found["first"]} {found["last"]}'.strip()
    if not name or name == 'Points Possible':  # the second line of Canvas
        return None
    texts = [row[headers[h]] or '' for h in (*_HEADERS['id'], *_HEADERS['login']) if h in headers]
    ids = frozenset(''.join(_words(text.partition('@')[0])) for text in texts) - {''}
    columns = {header: value or '' for header, value in row.items() if header}
    return Student(name, found['id'], found['section'], found['login'], ids, columns)


def owner(folder: str, students: Sequence[Student]) -> Student | None:
    """Return whose folder or archive this is, by its name; None where that is not clear.

    Canvas names a file `chenli_123457_998878_my_lab-2.zip`. An id counts more than a name.
    """
    words = _words(folder)
    by_id = [student for student in students if student.ids.intersection(words)]
    if len(by_id) == 1:
        return by_id[0]
    named = [(size, each) for each in by_id or students if (size := _name_in(words, each.name))]
    longest = max((size for size, _ in named), default=0)
    found = [student for size, student in named if size == longest]
    return found[0] if len(found) == 1 else None


def _name_in(words: list[str], name: str) -> int:
    """Return how many words of a name are in those of a folder, if all are; in one word, too."""
    parts = _words(name)
    turned = {''.join(parts[k:] + parts[:k]) for k in range(len(parts))}
    return len(parts) if turned.intersection(words) or set(parts) <= set(words) else 0


def _words(text: str) -> list[str]:
    """Return the words of a text: no accents, no capitals."""
    plain = unicodedata.normalize('NFKD', text.casefold())
    bare = ''.join(each for each in plain if not unicodedata.combining(each))
    return re.findall(r'[^\W_]+', bare)
