"""The grades of a class: a list, gradebooks of Canvas and Gradescope, a table and an HTML page.

Task 3 is on top: its points have a sum and a mean of their own, so that no mean is of 100 for some
and of 120 for others.
"""

from __future__ import annotations

import csv
import io
import re
import secrets
from collections import Counter
from statistics import mean, median
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from rich.markup import escape
from rich.table import Table

from barc_sim.errors import one_line
from barc_sim.lab.grade.roster import owner
from barc_sim.lab.grade.similarity import alike, in_words
from barc_sim.lab.hills.lab import LABELS
from barc_sim.lab.html import render

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from datetime import datetime

    from barc_sim.lab.grade.grade import Failure, Report
    from barc_sim.lab.grade.roster import Student
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.similarity import Passages

_BINS = 10  # of the distribution
_MISTAKES = 8  # rows
_SHORT = 30  # characters of a clause that needs the next one
# Where a message begins with a call and a line of code.
_PLACE = re.compile(r'^(call \d+, after [\d.]+ s on the road: )?([\w .()-]+\.py, line \d+: )?')
# What a spreadsheet takes for a formula, at the beginning of a cell: after any separator, as each
# splits at its own. Some of East Asia take the wide signs, too.
_FORMULA = re.compile(r'(^|[;,\t|])([\s"\'\\]*)(?=[=+\-@\uff1d\uff0b\uff0d\uff20])')
_ELSEWHERE = ('alike: ', 'no points')  # the looks that other columns show
_CANVAS = ('Student', 'ID', 'SIS User ID', 'SIS Login ID', 'Section')


class Entry(NamedTuple):
    """A line of the class: a submission, or a student who handed in nothing."""

    folder: str = ''
    report: Report | None = None
    student: Student | None = None
    newer: str = ''  #: the folder of a later submission of the same student, which counts
    alike: str = ''
    late: str = ''  #: by how much
    looks: tuple[str, ...] = ()  #: why a person looks at it

    @property
    def remark(self) -> str:
        """What is to be said of it, in one line."""
        own = self.report.remark if self.report else '' if self.folder else 'nothing handed in'
        newer = f'handed in again as {self.newer}' if self.newer else ''
        more = [look for look in self.looks if look not in own and not look.startswith(_ELSEWHERE)]
        return '; '.join(filter(None, (newer, *more, own)))


def entries(
    reports: Mapping[str, Report],
    failures: Mapping[str, Failure],
    students: Sequence[Student],
    due: datetime | None,
    handout: Passages,
) -> list[Entry]:
    """Return the class, by section and name; `reports` and `failures` are by folder."""
    owners = {name: owner(name, students) for name in {**reports, **failures}}
    newest: dict[Student | str, str] = {}
    for name in sorted(owners, key=lambda name: (_handed_in(reports.get(name)), name)):
        newest[owners[name] or name] = name
    counted = {name: report.passages for name, report in reports.items() if name in newest.values()}
    similar = alike(counted, handout)
    found = [Entry(student=student) for student in students if student not in newest]
    for name, student in owners.items():
        report = reports.get(name)
        newer = newest[student or name]
        others = in_words(similar.get(name, []))
        looks = [f'not graded: {failures[name].reason}'] if name in failures else []
        if report:
            looks += [*report.notes, *([f'alike: {others}'] if others else [])]
            eye = ', '.join(LABELS[criterion] for criterion in report.open)
            looks += [f'judge by eye: {eye}'] if eye else []
            looks += ['no points'] if not report.score and not report.open else []
        looks += ['not in the roster'] if students and not student else []
        found.append(
            Entry(
                *(name, report, student, newer if newer != name else '', others),
                *(_late(name, report, due), tuple(looks)),
            )
        )
    return sorted(found, key=lambda each: (_section(each), _name(each).casefold(), each.folder))


def _handed_in(report: Report | None) -> float:
    return report.handed_in if report else 0.0


def _late(name: str, report: Report | None, due: datetime | None) -> str:
    """Return by how much a submission is late; Canvas has a word for it in the file's name."""
    if due and report and (seconds := report.handed_in - due.timestamp()) > 0.0:
        minutes = round(seconds / 60.0)
        return f'{minutes // 60}:{minutes % 60:02} h'
    return 'yes' if '_LATE_' in name else ''


def _section(entry: Entry) -> str:
    return entry.student.section if entry.student else ''


def _name(entry: Entry) -> str:
    return entry.student.name if entry.student else entry.folder


def as_csv(found: Sequence[Entry], rubric: Rubric) -> str:
    """Return a line for each entry; open points, and those of what was not graded, are empty."""
    student = ['student', 'id', 'section'] if any(each.student for each in found) else []
    own = ['name', *student, 'score', 'max_score', *rubric.points]
    rows = []
    for each in found:
        row: dict[str, object] = {'name': each.folder, 'late': each.late, 'alike': each.alike}
        if each.student:
            whose = each.student
            row |= {'student': whose.name, 'id': whose.id, 'section': whose.section}
        if report := each.report:
            row |= {'score': report.score, 'max_score': report.max_score, **report.points}
            row |= {'open': sum(report.open.values()) or '', 'comment': report.comment}
        rows.append({**row, 'remark': each.remark})
    return _lines([*own, 'open', 'late', 'alike', 'comment', 'remark'], rows)


def _lines(fields: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fields, restval='', lineterminator='\n', extrasaction='ignore')
    writer.writerow(dict(zip(fields, map(_cell, fields), strict=True)))
    for row in rows:
        writer.writerow({key: _cell(v) if isinstance(v, str) else v for key, v in row.items()})
    return buffer.getvalue()


def _cell(text: str) -> str:
    return _FORMULA.sub(r"\1\2'", one_line(text))


def gradebooks(found: Sequence[Entry], rubric: Rubric) -> dict[str, str]:
    """Return the files for the gradebooks of Canvas and of Gradescope, by name.

    A score with open points is empty: a person gives these first.
    """
    title = one_line(rubric.title, 70) or 'Lab'
    third = f'{title}: Task 3'
    parts = {title: rubric.max_score, third: _sum(rubric, rubric.optional)}
    parts = {name: worth for name, worth in parts.items() if worth}
    canvas: list[dict[str, object]] = [{'Student': '    Points Possible', **parts}]
    gradescope: list[dict[str, object]] = []
    for each in found:
        if not each.student or each.newer:
            continue
        student, report = each.student, each.report
        own = {'Student': student.name, 'SIS User ID': student.id, 'SIS Login ID': student.login}
        own |= {'Section': student.section} | {
            name: value for name, value in student.columns.items() if name in _CANVAS
        }
        tasks = _tasks(report, rubric) if report else (None, None)
        canvas.append(own | dict(zip((title, third), tasks, strict=True)))
        is_whole = report is not None and not report.open
        gradescope.append(
            {
                'Name': student.name,
                'SID': student.id,
                'Email': student.login,
                'Sections': student.section,
                'Total Score': report.score if report and is_whole else '',
                'Max Points': report.max_score if report else rubric.max_score,
                'Status': 'Graded' if is_whole else 'Ungraded' if report else 'Missing',
                'Lateness (H:M:S)': each.late.replace(' h', ':00'),
            }
        )
    return {
        'canvas.csv': _lines([*_CANVAS, *parts], canvas),
        'gradescope.csv': _lines([*(gradescope or [{'Name': ''}])[0]], gradescope),
    }


def _sum(rubric: Rubric, criteria: Iterable[str]) -> float:
    return round(sum(rubric.points[name] for name in criteria), 2)


def _tasks(report: Report, rubric: Rubric) -> tuple[float | None, float | None]:
    """Return the points of the required criteria, and of Task 3; None: open, or not handed in."""

    def points(is_optional: bool) -> float | None:
        names = [name for name in rubric.points if (name in rubric.optional) == is_optional]
        if any(name in report.open for name in names):
            return None
        own = [report.points[name] for name in names if name in report.points]
        return round(sum(own), 2) if own else None

    return points(is_optional=False), points(is_optional=True)


class _Part(NamedTuple):
    """Figures of the points that the whole class can get."""

    title: str
    worth: float
    scores: list[float]

    @property
    def words(self) -> str:
        low, high = min(self.scores), max(self.scores)
        return f'median {median(self.scores):g}, {low:g} to {high:g}'


def _parts(reports: Sequence[Report], rubric: Rubric) -> list[_Part]:
    both = [*zip(*(_tasks(report, rubric) for report in reports), strict=True)] or [(), ()]
    titles = {'Score': rubric.max_score, 'Task 3': _sum(rubric, rubric.optional)}
    return [
        _Part(title, worth, [each for each in scores if each is not None])
        for (title, worth), scores in zip(titles.items(), both, strict=True)
    ]


def as_table(reports: Sequence[Report], rubric: Rubric) -> Table:
    """Return the points of one submission by criterion, or the means of several."""
    alone = len(reports) == 1
    title = escape(one_line(rubric.title, 70))
    table = Table(title=title, box=None, title_justify='left')
    table.add_column('Criterion')
    table.add_column('Points' if alone else 'Mean', justify='right')
    table.add_column('of', justify='right')
    if not alone:
        table.add_column('Full marks')
    for criterion, worth in rubric.points.items():
        points = [report.points[criterion] for report in reports if criterion in report.points]
        is_open = any(criterion in report.open for report in reports)
        if not points and not is_open and criterion in rubric.optional:
            continue
        value = f'{mean(points):.2f}' if points else 'open' if is_open else ''
        full = f'{sum(each >= worth for each in points)} of {len(points)}'
        table.add_row(LABELS[criterion], value, f'{worth:g}', *([] if alone else [full]))
    table.add_section()
    for part in _parts(reports, rubric):
        if part.scores:
            words = [] if alone else [part.words]
            table.add_row(part.title, f'{mean(part.scores):.2f}', f'{part.worth:g}', *words)
    return table


def page(found: Sequence[Entry], rubric: Rubric) -> str:
    """Return the class as one HTML page, with links to the reports beside it."""
    counted = [each.report for each in found if each.report and not each.newer]
    parts = [part for part in _parts(counted, rubric) if part.scores]
    bins = Counter(
        min(int(_BINS * score / part.worth), _BINS - 1)
        for part in parts[:1]
        for score in part.scores
    )
    criteria = [
        (LABELS[name], mean(points), worth, sum(each >= worth for each in points), len(points))
        for name, worth in rubric.points.items()
        if (points := [report.points[name] for report in counted if name in report.points])
    ]
    return render(
        'class',
        title=rubric.title,
        nonce=secrets.token_urlsafe(),
        numbers={
            'submissions': len(counted),
            'late': sum(bool(each.late) for each in found if not each.newer),
            'to judge by eye': sum(bool(report.open) for report in counted),
            'nothing handed in': sum(not each.folder for each in found),
        },
        parts=[
            (part.title, mean(part.scores), part.worth, part.words, len(part.scores))
            for part in parts
        ],
        bins=[(k * 100 // _BINS, (k + 1) * 100 // _BINS, bins[k]) for k in range(_BINS)],
        tallest=max(bins.values(), default=1),
        criteria=criteria,
        mistakes=_mistakes(counted),
        sections=sorted({_section(each) for each in found} - {''}),
        rows=[_row(each) for each in found],
    )


def _mistakes(reports: Iterable[Report]) -> list[tuple[str, str, int]]:
    """Return the commonest mistakes: criterion, message, and how many made it."""
    counts: Counter[str] = Counter()
    criteria: dict[str, str] = {}
    for report in reports:
        found = {_in_general(text): name for name, text in reversed([*report.mistakes.items()])}
        counts.update([*found])
        criteria |= found
    return [(LABELS[criteria[text]], text, n) for text, n in counts.most_common(_MISTAKES)]


def _in_general(message: str) -> str:
    """Return the beginning of a message, without what differs between submissions."""
    # Brackets after a word, but not those of a formula.
    words = re.sub(r'(?<=[\w°]) \([^()*+/=]*\)', '', _PLACE.sub('', message))
    first, *others = re.split(r'; |: |\. ', words)
    if others and len(first) < _SHORT:
        first = f'{first}: {others[0]}'
    return one_line(re.sub(r'(?<![\w*])\d[\d.,]*\b', '\N{HORIZONTAL ELLIPSIS}', first), 90)


def _row(entry: Entry) -> dict[str, object]:
    report = entry.report
    flags = {
        'look': bool(entry.looks),
        'late': bool(entry.late),
        'open': bool(report and report.open),
        'alike': bool(entry.alike),
        'older': bool(entry.newer),
        'missing': not entry.folder,
    }
    return {
        'name': _name(entry),
        'folder': entry.folder if entry.student else '',
        'section': _section(entry),
        'link': f'{quote(entry.folder)}/report.html' if report else '',
        'score': report.score if report else None,
        'max_score': report.max_score if report else None,
        'open': sum(report.open.values()) if report else 0,
        'late': entry.late,
        'flags': ' '.join(name for name, is_set in flags.items() if is_set),
        'looks': entry.looks,
        'newer': entry.newer,
        'comment': report.comment if report else '',
        'remark': report.remark if report else '' if entry.folder else 'nothing handed in',
    }
