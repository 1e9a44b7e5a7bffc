"""Grades of a class: reads the roster; writes a CSV file, a gradebook and an HTML page.

The extra points of Task 3 have a separate sum and mean: otherwise some scores in a mean would be
out of 100 and others out of 120.
"""

from __future__ import annotations

import csv
import io
import re
import secrets
import unicodedata
from collections import Counter
from dataclasses import dataclass
from itertools import zip_longest
from statistics import mean, median
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.csv_files import read_rows
from barc_sim.cli.text import one_line
from barc_sim.errors import UserError
from barc_sim.lab.grade.grade import LABELS
from barc_sim.lab.pages import render

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from barc_sim.lab.grade.grade import Grade, Item, Rubric

#: The possible headers of each column, in lower case, also of Canvas and Gradescope.
_HEADERS = {
    'name': ('name', 'student', 'full name'),
    'first': ('first name', 'given name'),
    'last': ('last name', 'surname', 'family name'),
    'id': ('id', 'sid', 'student id', 'sis user id'),
    'login': ('sis login id', 'login', 'email', 'e-mail'),
    'section': ('section', 'sections'),
}
_BINS = 10  # of the histogram
_MISTAKES = 8  # rows
_SHOWN = 90  # characters of a message
# The call and the line of code at the beginning of a message, and the arguments of a function.
_PLACE = re.compile(
    r'^(call \d+, after [\d.]+ s on the road: )?([\w .()-]+\.py, line \d+: )?|\(\w+=[-\[\d][^()]*\)'
)
# The start of a cell that a spreadsheet takes for a formula, also after a separator.
_FORMULA = re.compile(r'(^|[;,\t|])([\s"\'\\]*)(?=[=+\-@])')
_CANVAS = ('Student', 'ID', 'SIS User ID', 'SIS Login ID', 'Section')


@dataclass(frozen=True, eq=False)
class Student:
    """A row of the roster."""

    name: str
    id: str
    section: str
    login: str  #: or e-mail address
    ids: frozenset[str]  #: words that can be in the name of the student's folder
    columns: dict[str, str]  #: cells of the roster, by header


def read_roster(path: Path) -> list[Student]:
    """Return the students in a CSV file with the columns name, id and section.

    It also reads an export of Canvas's gradebook, a roster of Gradescope, and what Excel saves.
    """
    try:
        rows = read_rows(path)
    except UserError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise UserError(f'the roster {str(path)!r} cannot be read: {reason}') from None

    first = rows[0] if rows else []
    headers = {header.strip().lower(): header for header in first if header.strip()}
    if not {'name', 'student', 'full name', 'last name'} & headers.keys():
        raise UserError(
            f'the roster {str(path)!r} has no column name: expected a first line such as '
            'name,id,section'
        )

    students = []
    for row in rows[1:]:
        cells = dict(zip_longest(first, row[: len(first)], fillvalue=''))
        student = _student(cells, headers)
        if student:
            students.append(student)
    return students


def _student(row: dict[str, str], headers: dict[str, str]) -> Student | None:
    """Return the student in a row of cells by header; None if it has none.

    `headers` are those of the roster, by their text in lower case.
    """

    def cell(field: str) -> str:
        values = [row[headers[each]] for each in _HEADERS[field] if each in headers]
        return values[0].strip() if values else ''

    name = cell('name') or f'{cell("first")} {cell("last")}'.strip()
    if not name or name == 'Points Possible':  # the second line of Canvas's export
        return None

    id_headers = (*_HEADERS['id'], *_HEADERS['login'])
    texts = [row[headers[each]] for each in id_headers if each in headers]
    ids = frozenset(''.join(_words(text.partition('@')[0])) for text in texts) - {''}
    return Student(
        name,
        id=cell('id'),
        section=cell('section'),
        login=cell('login'),
        ids=ids,
        columns={header: value for header, value in row.items() if header},
    )


def owner(folder: str, students: Sequence[Student]) -> Student | None:
    """Return the student to whom a folder or archive belongs, by its name; None if unclear.

    Canvas names a file `chenli_123457_998878_my_lab-2.zip`. An id counts more than a name.
    """
    words = _words(folder)
    by_id = [student for student in students if student.ids.intersection(words)]
    if len(by_id) == 1:
        return by_id[0]

    sizes = {student: _name_in(words, student.name) for student in by_id or students}
    longest = max(sizes.values(), default=0)
    best = [student for student, size in sizes.items() if size == longest > 0]
    return best[0] if len(best) == 1 else None


def _name_in(words: list[str], name: str) -> int:
    """Return the number of words of a name if a folder has all of them, else 0.

    The folder can also have them as one word, such as `chenli`.
    """
    parts = _words(name)
    turned = {''.join(parts[k:] + parts[:k]) for k in range(len(parts))}
    return len(parts) if turned.intersection(words) or set(parts) <= set(words) else 0


def _words(text: str) -> list[str]:
    """Return the words of a text in lower case, without accents."""
    plain = unicodedata.normalize('NFKD', text.casefold())
    bare = ''.join(each for each in plain if not unicodedata.combining(each))
    return re.findall(r'[^\W_]+', bare)


class ClassEntry(NamedTuple):
    """A line of the class: a submission, or a student who handed in nothing."""

    folder: str = ''
    grade: Grade | None = None
    student: Student | None = None
    looks: tuple[str, ...] = ()  #: reasons for a person to look at it

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
        """The remark on its grade, in one line."""
        if self.grade:
            return self.grade.remark
        return '' if self.folder else 'nothing handed in'

    @property
    def flags(self) -> list[str]:
        """The values of the page's filter that show this entry."""
        grade = self.grade
        flags = {
            'look': self.looks or (grade and not (grade.score or grade.open)),
            'open': grade and grade.open,
            'missing': not self.folder,
        }
        return [name for name, is_set in flags.items() if is_set]


def entries(
    grades: Mapping[str, Grade], failures: Mapping[str, str], students: Sequence[Student]
) -> list[ClassEntry]:
    """Return the class, by section and name; `grades` and `failures` are by folder."""
    owners = {name: owner(name, students) for name in {**grades, **failures}}
    counts = Counter(owners.values())
    rows = [ClassEntry(student=student) for student in students if not counts[student]]
    for name, student in owners.items():
        grade = grades.get(name)
        looks = []
        if name in failures:
            looks.append(f'not graded: {failures[name]}')
        if grade:
            looks += grade.notes
            if grade.open:
                by_eye = ', '.join(LABELS[criterion] for criterion in grade.open)
                looks.append(f'judge by eye: {by_eye}')
        if students and not student:
            looks.append('not in the roster')
        if student and counts[student] > 1:
            looks.append('handed in more than once')
        rows.append(ClassEntry(name, grade, student, tuple(looks)))
    return sorted(rows, key=lambda each: (each.section, each.name.casefold(), each.folder))


def as_csv(all_entries: Sequence[ClassEntry], rubric: Rubric) -> str:
    """Return a CSV line for each entry; points that are open or not graded are empty."""
    columns = ['name']
    if any(entry.student for entry in all_entries):
        columns += ['student', 'id', 'section']
    columns += ['score', 'max_score', *rubric.points, 'open', 'comment', 'remark']

    rows = []
    for entry in all_entries:
        row: dict[str, object] = {'name': entry.folder}
        if entry.student:
            row |= {'student': entry.name, 'id': entry.student.id, 'section': entry.section}
        grade = entry.grade
        if grade:
            row |= {'score': grade.score, 'max_score': grade.max_score, **grade.points}
            row |= {'open': sum(grade.open.values()) or '', 'comment': grade.comment}
        row['remark'] = '; '.join(filter(None, (*entry.looks, entry.remark)))
        rows.append(row)
    return _lines(columns, rows)


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
    """Criteria with a common sum: the required ones, those of Task 3, or a single one."""

    title: str
    criteria: tuple[str, ...]
    worth: float

    def score(self, grade: Grade | None) -> float | None:
        """Return the points for these criteria; None if some are open, or nothing was handed in."""
        if grade is None or not grade.open.keys().isdisjoint(self.criteria):
            return None
        points = [grade.points[name] for name in self.criteria if name in grade.points]
        return round(sum(points), 2) if points else None


def _tasks(rubric: Rubric, title: str) -> list[_Task]:
    def named(task: str) -> str:
        return f'{title}: {task}' if title != 'Score' else task

    by_eye = rubric.lab.by_eye.keys() - rubric.optional
    kinds = {
        title: rubric.points.keys() - rubric.optional - by_eye,
        named('Task 3'): rubric.optional,
        named('By eye'): by_eye,
    }
    tasks = []
    for name, criteria in kinds.items():
        ordered = tuple(each for each in rubric.points if each in criteria)
        worth = round(sum(rubric.points[each] for each in ordered), 2)
        tasks.append(_Task(name, ordered, worth))
    return [task for task in tasks if task.worth]


def canvas(all_entries: Sequence[ClassEntry], rubric: Rubric) -> str:
    """Return the CSV file for Canvas's gradebook.

    A score is empty if it has open points, or if the student has several submissions: a person
    must first give the points, or choose a submission.
    """
    tasks = _tasks(rubric, one_line(rubric.title, 70) or 'Lab')
    worth = {task.title: task.worth for task in tasks}
    rows: list[dict[str, object]] = [{'Student': 'Points Possible', **worth}]

    by_student: dict[Student, list[ClassEntry]] = {}
    for entry in all_entries:
        if entry.student:
            by_student.setdefault(entry.student, []).append(entry)

    for student, submissions in by_student.items():
        row = {
            'Student': student.name,
            'SIS User ID': student.id,
            'SIS Login ID': student.login,
            'Section': student.section,
        }
        row |= {name: value for name, value in student.columns.items() if name in _CANVAS}
        grade = submissions[0].grade if len(submissions) == 1 else None
        rows.append(row | {task.title: task.score(grade) for task in tasks})
    return _lines([*_CANVAS, *worth], rows)


def _rows(tasks: Iterable[_Task], grades: Sequence[Grade]) -> list[dict[str, Any]]:
    """Return statistics of each task for which at least one grade has points."""
    rows = []
    for task in tasks:
        all_scores = [task.score(grade) for grade in grades]
        scores = [score for score in all_scores if score is not None]
        if not scores:
            continue
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
    lines = []
    for row in _rows(_tasks(rubric, 'Score'), grades):
        line = f'{row["title"]:6}  {row["mean"]:.2f} of {row["worth"]:g}'
        if len(grades) > 1:
            line += f'  ({row["words"]})'
        lines.append(line)
    return lines


def class_page(all_entries: Sequence[ClassEntry], rubric: Rubric) -> str:
    """Return the class as one HTML page, with links to the reports beside it."""
    grades = [entry.grade for entry in all_entries if entry.grade]
    tasks = _rows(_tasks(rubric, 'Score'), grades)
    criteria = [_Task(LABELS[name], (name,), worth) for name, worth in rubric.points.items()]

    bins: Counter[int] = Counter()
    if tasks:
        worth = tasks[0]['worth']
        bins.update(min(int(_BINS * score / worth), _BINS - 1) for score in tasks[0]['scores'])

    return render(
        'class',
        title=rubric.title,
        nonce=secrets.token_urlsafe(),
        numbers={
            'submissions': len(grades),
            'to judge by eye': sum(bool(grade.open) for grade in grades),
            'nothing handed in': sum(not each.folder for each in all_entries),
        },
        tasks=tasks,
        bins=[(k * 100 // _BINS, (k + 1) * 100 // _BINS, bins[k]) for k in range(_BINS)],
        tallest=max(bins.values(), default=1),
        criteria=_rows(criteria, grades),
        mistakes=_mistakes(grades),
        sections=sorted({each.section for each in all_entries} - {''}),
        entries=all_entries,
    )


def _mistakes(grades: Iterable[Grade]) -> list[tuple[str, str, int]]:
    """Return the commonest mistakes: criterion, first message, and number of submissions."""
    counts: Counter[str] = Counter()
    first: dict[str, Item] = {}
    for grade in grades:
        # A message on several criteria counts once, for the one that lost most.
        by_text = {_in_general(item.message): item for item in reversed(grade.mistakes)}
        counts.update(by_text.keys())
        first = by_text | first

    rows = []
    for text, number in counts.most_common(_MISTAKES):
        item = first[text]
        message = one_line(_PLACE.sub('', item.message), _SHOWN)
        rows.append((LABELS[item.criterion], message, number))
    return rows


def _in_general(message: str) -> str:
    """Return the beginning of a message without its numbers, which differ between submissions."""
    general = re.sub(r'(?<![\w*])\d[\d.,]*\b', '\N{HORIZONTAL ELLIPSIS}', _PLACE.sub('', message))
    return one_line(general, _SHOWN)
