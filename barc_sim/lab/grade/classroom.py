"""A class: its roster, and its grades as a list, a gradebook and an HTML page.

Task 3 is on top: its points have a sum and a mean of their own, so that no mean is of 100 for some
and of 120 for others.
"""

from __future__ import annotations

import csv
import io
import re
import secrets
import unicodedata
from collections import Counter
from dataclasses import dataclass
from statistics import mean, median
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError, one_line
from barc_sim.lab.grade.grade import LABELS
from barc_sim.lab.pages import render

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from barc_sim.lab.grade.grade import Grade, Item, Rubric

_MAX_ROSTER = 4 << 20  # bytes
#: The headers of a column, in lower case: those of Canvas and of Gradescope among them.
_HEADERS = {
    'name': ('name', 'student', 'full name'),
    'first': ('first name', 'given name'),
    'last': ('last name', 'surname', 'family name'),
    'id': ('id', 'sid', 'student id', 'sis user id'),
    'login': ('sis login id', 'login', 'email', 'e-mail'),
    'section': ('section', 'sections'),
}
_BINS = 10  # of the distribution
_MISTAKES, _SHOWN = 8, 90  # rows, and characters of a message
# Where a message begins with a call and a line of code, and what was passed to a function.
_PLACE = re.compile(
    r'^(call \d+, after [\d.]+ s on the road: )?([\w .()-]+\.py, line \d+: )?|\(\w+=[-\[\d][^()]*\)'
)
# What a spreadsheet takes for a formula, after any separator that it splits at.
_FORMULA = re.compile(r'(^|[;,\t|])([\s"\'\\]*)(?=[=+\-@])')
_CANVAS = ('Student', 'ID', 'SIS User ID', 'SIS Login ID', 'Section')


@dataclass(frozen=True, eq=False)
class Student:
    """A row of the roster."""

    name: str
    id: str
    section: str
    login: str  #: or address
    ids: frozenset[str]  #: all that can stand in the name of a folder, as words
    columns: dict[str, str]  #: of the file, by header


def read_roster(path: Path) -> list[Student]:
    """Return the students of a CSV file with the columns name, id and section, or a UserError.

    An export of the gradebook of Canvas, and a roster of Gradescope, are such files.
    """
    try:
        text = read_regular(path, _MAX_ROSTER).decode('utf-8-sig')
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


class Entry(NamedTuple):
    """A line of the class: a submission, or a student who handed in nothing."""

    folder: str = ''
    grade: Grade | None = None
    student: Student | None = None
    looks: tuple[str, ...] = ()  #: why a person looks at it, beside no points

    @property
    def name(self) -> str:
        """The student's name, else the folder's."""
        return self.student.name if self.student else self.folder

    @property
    def section(self) -> str:
        """The student's section."""
        return self.student.section if self.student else ''

    @property
    def remark(self) -> str:
        """What its grade has to remark, in one line."""
        return self.grade.remark if self.grade else '' if self.folder else 'nothing handed in'

    @property
    def flags(self) -> list[str]:
        """The words by which the page shows some of the class."""
        grade = self.grade
        flags = {
            'look': self.looks or (grade and not (grade.score or grade.open)),
            'open': grade and grade.open,
            'missing': not self.folder,
        }
        return [name for name, is_set in flags.items() if is_set]


def entries(
    grades: Mapping[str, Grade], failures: Mapping[str, str], students: Sequence[Student]
) -> list[Entry]:
    """Return the class, by section and name; `grades` and `failures` are by folder."""
    owners = {name: owner(name, students) for name in {**grades, **failures}}
    counts = Counter(owners.values())
    found = [Entry(student=student) for student in students if not counts[student]]
    for name, student in owners.items():
        grade = grades.get(name)
        looks = [f'not graded: {failures[name]}'] if name in failures else []
        if grade:
            eye = ', '.join(LABELS[criterion] for criterion in grade.open)
            looks += [*grade.notes, *([f'judge by eye: {eye}'] if eye else [])]
        looks += ['not in the roster'] if students and not student else []
        looks += ['handed in more than once'] if student and counts[student] > 1 else []
        found.append(Entry(name, grade, student, tuple(looks)))
    return sorted(found, key=lambda each: (each.section, each.name.casefold(), each.folder))


def as_csv(found: Sequence[Entry], rubric: Rubric) -> str:
    """Return a line for each entry; open points, and those of what was not graded, are empty."""
    student = ['student', 'id', 'section'] if any(each.student for each in found) else []
    rows = []
    for each in found:
        row: dict[str, object] = {'name': each.folder}
        if each.student:
            row |= {'student': each.name, 'id': each.student.id, 'section': each.section}
        if grade := each.grade:
            row |= {'score': grade.score, 'max_score': grade.max_score, **grade.points}
            row |= {'open': sum(grade.open.values()) or '', 'comment': grade.comment}
        rows.append({**row, 'remark': '; '.join(filter(None, (*each.looks, each.remark)))})
    own = ['name', *student, 'score', 'max_score', *rubric.points]
    return _lines([*own, 'open', 'comment', 'remark'], rows)


def _lines(fields: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fields, restval='', lineterminator='\n', extrasaction='ignore')
    writer.writerow(dict(zip(fields, map(_cell, fields), strict=True)))
    for row in rows:
        writer.writerow({key: _cell(v) if isinstance(v, str) else v for key, v in row.items()})
    return buffer.getvalue()


def _cell(text: str) -> str:
    return _FORMULA.sub(r"\1\2'", one_line(text))


class _Task(NamedTuple):
    """Criteria whose points count together: the required ones, those of Task 3, or a single one."""

    title: str
    criteria: tuple[str, ...]
    worth: float

    def score(self, grade: Grade | None) -> float | None:
        """Return the points for these criteria; None: open, or not handed in."""
        own = (
            [grade.points[name] for name in self.criteria if name in grade.points] if grade else []
        )
        is_open = grade and not grade.open.keys().isdisjoint(self.criteria)
        return round(sum(own), 2) if own and not is_open else None


def _tasks(rubric: Rubric, title: str) -> list[_Task]:
    def named(task: str) -> str:
        return f'{title}: {task}' if title != 'Score' else task

    eye = rubric.lab.by_eye.keys() - rubric.optional
    kinds = {
        title: rubric.points.keys() - rubric.optional - eye,
        named('Task 3'): rubric.optional,
        named('By eye'): eye,
    }
    found = []
    for name, criteria in kinds.items():
        own = tuple(each for each in rubric.points if each in criteria)
        found.append(_Task(name, own, round(sum(rubric.points[each] for each in own), 2)))
    return [task for task in found if task.worth]


def canvas(found: Sequence[Entry], rubric: Rubric) -> str:
    """Return the file for the gradebook of Canvas.

    A score with open points is empty, because a person gives these first; so is that of a student
    with several submissions, because a person chooses one.
    """
    tasks = _tasks(rubric, one_line(rubric.title, 70) or 'Lab')
    worth = {task.title: task.worth for task in tasks}
    rows: list[dict[str, object]] = [{'Student': 'Points Possible', **worth}]
    of_students: dict[Student, list[Entry]] = {}
    for each in found:
        if each.student:
            of_students.setdefault(each.student, []).append(each)
    for student, (first, *others) in of_students.items():
        own = {
            'Student': student.name,
            'SIS User ID': student.id,
            'SIS Login ID': student.login,
            'Section': student.section,
        }
        own |= {name: value for name, value in student.columns.items() if name in _CANVAS}
        grade = None if others else first.grade
        rows.append(own | {task.title: task.score(grade) for task in tasks})
    return _lines([*_CANVAS, *worth], rows)


def _rows(tasks: Iterable[_Task], grades: Sequence[Grade]) -> list[dict[str, Any]]:
    """Return the points for each task that somebody has points for."""
    rows = []
    for task in tasks:
        scores = [score for grade in grades if (score := task.score(grade)) is not None]
        if scores:
            full = sum(score >= task.worth for score in scores)
            spread = f'{min(scores):g} to {max(scores):g}'
            rows.append(
                {
                    **task._asdict(),
                    'scores': scores,
                    'mean': mean(scores),
                    'full': f'{full} of {len(scores)}',
                    'words': f'median {median(scores):g}, {spread}',
                }
            )
    return rows


def summary(grades: Sequence[Grade], rubric: Rubric) -> list[str]:
    """Return the score of one submission, or the means of several, a line for each task."""
    return [
        f'{row["title"]:6}  {row["mean"]:.2f} of {row["worth"]:g}'
        + (f'  ({row["words"]})' if len(grades) > 1 else '')
        for row in _rows(_tasks(rubric, 'Score'), grades)
    ]


def page(found: Sequence[Entry], rubric: Rubric) -> str:
    """Return the class as one HTML page, with links to the reports beside it."""
    grades = [each.grade for each in found if each.grade]
    tasks = _rows(_tasks(rubric, 'Score'), grades)
    criteria = [_Task(LABELS[name], (name,), worth) for name, worth in rubric.points.items()]
    bins = Counter(
        min(int(_BINS * score / task['worth']), _BINS - 1)
        for task in tasks[:1]
        for score in task['scores']
    )
    return render(
        'class',
        title=rubric.title,
        nonce=secrets.token_urlsafe(),
        numbers={
            'submissions': len(grades),
            'to judge by eye': sum(bool(grade.open) for grade in grades),
            'nothing handed in': sum(not each.folder for each in found),
        },
        tasks=tasks,
        bins=[(k * 100 // _BINS, (k + 1) * 100 // _BINS, bins[k]) for k in range(_BINS)],
        tallest=max(bins.values(), default=1),
        criteria=_rows(criteria, grades),
        mistakes=_mistakes(grades),
        sections=sorted({each.section for each in found} - {''}),
        entries=found,
    )


def _mistakes(grades: Iterable[Grade]) -> list[tuple[str, str, int]]:
    """Return the commonest mistakes: criterion, the first message, and how many made it."""
    counts: Counter[str] = Counter()
    first: dict[str, Item] = {}
    for grade in grades:
        # A message of several criteria counts for the one that lost most.
        found = {_in_general(item.message): item for item in reversed(grade.mistakes)}
        counts.update([*found])
        first = found | first
    common = [(first[text], n) for text, n in counts.most_common(_MISTAKES)]
    return [
        (LABELS[item.criterion], one_line(_PLACE.sub('', item.message), _SHOWN), n)
        for item, n in common
    ]


def _in_general(message: str) -> str:
    """Return the beginning of a message, without what differs between submissions: its numbers."""
    general = re.sub(r'(?<![\w*])\d[\d.,]*\b', '\N{HORIZONTAL ELLIPSIS}', _PLACE.sub('', message))
    return one_line(general, _SHOWN)
