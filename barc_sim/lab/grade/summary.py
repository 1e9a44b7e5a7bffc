"""The grades of a class: a CSV file, a table, and an overview."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from operator import itemgetter
from statistics import mean, median
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from barc_sim.errors import one_line
from barc_sim.lab.grade.similarity import in_words
from barc_sim.lab.hills.lab import LABELS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from barc_sim.lab.grade.grade import Failure, Report
    from barc_sim.lab.grade.rubric import Rubric

    Alike = Mapping[str, list[tuple[str, float]]]  #: as `similarity.alike` returns it

_BINS, _BAR = 10, 40  # of the distribution: rows, and characters of the widest bar
_MISTAKES, _LOOKS = 5, 20  # rows
_SHORT = 30  # characters of a clause that needs the next one
# Where a message begins with a call and a line of code.
_PLACE = re.compile(r'^(call \d+, after [\d.]+ s on the road: )?([\w .()-]+\.py, line \d+: )?')
# What a spreadsheet takes for a formula, at the beginning of a cell: after any separator, as each
# splits at its own. Some of East Asia take the wide signs, too.
_FORMULA = re.compile(r'(^|[;,\t|])([\s"\'\\]*)(?=[=+\-@\uff1d\uff0b\uff0d\uff20])')


def as_csv(
    reports: Sequence[Report], failures: Mapping[str, Failure], rubric: Rubric, alike: Alike
) -> str:
    """Return a line for each submission: score, points by criterion, who is alike, a remark.

    A submission that could not be graded has no numbers.
    """
    fields = ['name', 'score', 'max_score', *rubric.points, 'alike', 'remark']
    rows: list[dict[str, object]] = [
        {
            'name': report.name,
            'score': report.score,
            'max_score': report.max_score,
            **report.points,
            'alike': in_words(alike.get(report.name, [])),
            'remark': report.remark,
        }
        for report in reports
    ]
    rows += [
        {'name': name, 'max_score': rubric.max_score, 'remark': f'not graded: {failure.reason}'}
        for name, failure in failures.items()
    ]
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fields, restval='', lineterminator='\n')
    writer.writeheader()
    for row in sorted(rows, key=itemgetter('name')):
        writer.writerow({key: _cell(v) if isinstance(v, str) else v for key, v in row.items()})
    return buffer.getvalue()


def _cell(text: str) -> str:
    return _FORMULA.sub(r"\1\2'", one_line(text))


def as_table(reports: Sequence[Report], rubric: Rubric) -> Table:
    """Return the points of one submission by criterion, or the means of several."""
    alone = len(reports) == 1
    scores = [report.score for report in reports]
    title = one_line(rubric.title, 70)
    table = Table(title=escape(title), box=None, title_justify='left', show_footer=True)
    total = f'{mean(scores):.2f}' if scores else ''
    table.add_column('Criterion', footer='Score')
    table.add_column('Points' if alone else 'Mean', footer=total, justify='right')
    greatest = max((report.max_score for report in reports), default=rubric.max_score)
    table.add_column('of', footer=f'{greatest:g}', justify='right')
    if not alone:
        middle = f'median {median(scores):g}, {min(scores):g} to {max(scores):g}' if scores else ''
        table.add_column('Full marks', footer=middle, justify='left')
    for criterion, worth in rubric.points.items():
        points = [report.points[criterion] for report in reports if criterion in report.points]
        if not points and criterion in rubric.optional:
            continue
        row = [LABELS[criterion], f'{mean(points):.2f}' if points else '', f'{worth:g}']
        if not alone:
            row.append(f'{sum(value == worth for value in points)} of {len(points)}')
        table.add_row(*row)
    return table


def overview(
    reports: Sequence[Report], failures: Mapping[str, Failure], rubric: Rubric, alike: Alike
) -> Iterator[Table]:
    """Yield the tables on a class: distribution, commonest mistakes, who needs a look."""
    # Those with Task 3 have more points to reach: what counts is the share.
    shares = [report.score / report.max_score for report in reports]
    yield _distribution([share * rubric.max_score for share in shares], rubric.max_score)
    mistakes: Counter[str] = Counter()
    criteria: dict[str, str] = {}
    for report in reports:
        found = {_in_general(text): name for name, text in reversed([*report.mistakes.items()])}
        mistakes.update([*found])
        criteria |= found
    if mistakes:
        table = _table('Commonest mistakes', 'Who', 'Criterion', 'Message')
        for message, count in mistakes.most_common(_MISTAKES):
            table.add_row(str(count), LABELS[criteria[message]], escape(message))
        yield table
    if looks := dict(_looks(reports, failures, alike)):
        table = _table('Who needs a look', 'Name', 'Why')
        for name, why in [*looks.items()][:_LOOKS]:
            table.add_row(escape(one_line(name, 40)), escape(one_line(why, 200)))
        if len(looks) > _LOOKS:
            table.add_row(f'and {len(looks) - _LOOKS} more', 'see class.csv')
        yield table


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, box=None, title_justify='left', show_header=False)
    for column in columns:
        table.add_column(column, justify='right' if column == 'Who' else 'left')
    return table


def _distribution(scores: Sequence[float], greatest: float) -> Table:
    """Return a bar for each tenth of the points."""
    counts = Counter(min(int(_BINS * score / greatest), _BINS - 1) for score in scores)
    widest = max(counts.values(), default=0)
    table = _table('Distribution', 'Points', 'Who', 'Bar')
    for k in range(_BINS):
        low, high = (greatest * edge / _BINS for edge in (k, k + 1))
        bar = '\N{FULL BLOCK}' * round(_BAR * counts[k] / max(widest, _BAR))
        least = '\N{LEFT ONE EIGHTH BLOCK}' if counts[k] else ''
        table.add_row(f'{low:g} to {high:g}', str(counts[k]), bar or least)
    return table


def _in_general(message: str) -> str:
    """Return the beginning of a message, without what differs between submissions."""
    words = re.sub(r' ?\([^()]*\)', '', _PLACE.sub('', message))
    first, *others = re.split(r'; |: |\. ', words)
    if others and len(first) < _SHORT:
        first = f'{first}: {others[0]}'
    return one_line(re.sub(r'\d[\d.,]*\b', '\N{HORIZONTAL ELLIPSIS}', first), 90)


def _looks(
    reports: Sequence[Report], failures: Mapping[str, Failure], alike: Alike
) -> Iterator[tuple[str, str]]:
    for name, failure in failures.items():
        yield name, f'not graded: {failure.reason}'
    for report in sorted(reports, key=lambda report: (report.score, report.name)):
        others = alike.get(report.name, [])
        whys = [*report.notes, *([f'alike: {in_words(others)}'] if others else [])]
        if not report.score:
            whys.append(f'no points: {report.remark}' if not report.notes else 'no points')
        if whys:
            yield report.name, '; '.join(whys)
