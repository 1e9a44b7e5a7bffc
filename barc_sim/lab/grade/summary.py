"""The grades of a class: a CSV file and a table."""

from __future__ import annotations

import csv
import io
from operator import itemgetter
from statistics import mean, median
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from barc_sim.lab.grade.text import label, one_line

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.grade.batch import Failure
    from barc_sim.lab.grade.report import Report
    from barc_sim.lab.grade.rubric import Rubric

# Spreadsheets treat a cell that begins with one of these as a formula.
_FORMULA = ('=', '+', '-', '@', '\t')


def as_csv(reports: Sequence[Report], failures: Mapping[str, Failure], rubric: Rubric) -> str:
    """Return a line for each submission: its score, its points by criterion, and a remark.

    A submission that could not be graded has no numbers.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator='\n')
    writer.writerow(['name', 'score', 'max_score', *rubric.points, 'remark'])
    rows: list[tuple[str, list[object]]] = [
        (report.name, [report.score, report.max_score, *report.points.values(), report.remark])
        for report in reports
    ]
    rows += [
        (name, ['', rubric.max_score, *[''] * len(rubric.points), f'not graded: {failure.reason}'])
        for name, failure in failures.items()
    ]
    for name, (*numbers, remark) in sorted(rows, key=itemgetter(0)):
        writer.writerow([_cell(name), *numbers, _cell(str(remark))])
    return buffer.getvalue()


def _cell(text: str) -> str:
    line = one_line(text)
    return f"'{line}" if line.startswith(_FORMULA) else line


def as_table(reports: Sequence[Report], rubric: Rubric) -> Table:
    """Return the points of one submission by criterion, or the means of several."""
    alone = len(reports) == 1
    scores = [report.score for report in reports]
    title = one_line(rubric.title, 70)
    table = Table(title=escape(title), box=None, title_justify='left', show_footer=True)
    total = f'{mean(scores):.2f}' if scores else ''
    table.add_column('Criterion', footer='Score')
    table.add_column('Points' if alone else 'Mean', footer=total, justify='right')
    table.add_column('of', footer=f'{rubric.max_score:g}', justify='right')
    if not alone:
        middle = f'median {median(scores):g}, {min(scores):g} to {max(scores):g}' if scores else ''
        table.add_column('Full marks', footer=middle, justify='left')
    for criterion, worth in rubric.points.items():
        points = [report.points[criterion] for report in reports]
        row = [label(criterion), f'{mean(points):.2f}' if points else '', f'{worth:g}']
        if not alone:
            row.append(f'{sum(value == worth for value in points)} of {len(points)}')
        table.add_row(*row)
    return table
