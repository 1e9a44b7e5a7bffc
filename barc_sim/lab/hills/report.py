"""Prints the findings in a terminal, or a line for each in a pipe."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from barc_sim.errors import one_line
from barc_sim.lab.hills.loop import Comparison

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from barc_sim.lab.check.findings import Finding
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.hills.lab import Report
    from barc_sim.lab.hills.loop import Stretch

_PIPE = 10_000  #: columns: a line is never broken
_LINES, _WIDTH = 5, 100  #: of the text that user code printed


def print_report(report: Report, rubric: Rubric, console: Console | None = None) -> None:
    """Print a report."""
    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.width = _PIPE
    worth = rubric.worth(report.findings)
    findings = [each for each in report.findings if each.criterion in worth]
    _print_table(console, ('criterion', 'points', 'finding'), _rows(findings, rubric))
    compared = [each.evidence for each in findings if isinstance(each.evidence, Comparison)]
    for comparison in compared:
        _plain(console, "the lab's road, stretch by stretch")
        header = ('from', 'grade', 'RMS', 'at most', 'the speed')
        _print_table(console, header, map(_cells, comparison.stretches))
    if report.gains:
        _plain(console, f'gains: {report.gains}')
    if report.tolerated:
        _plain(console, f'tolerated: {"; ".join(report.tolerated)}')
    _print_output(report.printed, console)
    judged = [finding for finding in report.findings if not finding.skipped]
    passed = sum(finding.passed for finding in judged)
    total = round(sum(rubric.points_for(finding) for finding in findings), 2)
    maximum = round(sum(worth.values()), 2)
    _plain(
        console,
        f'{passed} of {len(judged)} criteria are met in full: {total:g} of {maximum:g} points',
    )


def _rows(findings: Sequence[Finding], rubric: Rubric) -> Iterable[tuple[Text, ...]]:
    """Yield the cells of each finding; a repeated message refers to its first criterion."""
    first = {each.message: each.criterion for each in reversed(findings) if not each.passed}
    for each in findings:
        colour = 'dim' if each.skipped else 'green' if each.passed else 'red'
        points = f'{rubric.points_for(each):g} / {rubric.points[each.criterion]:g}'
        where = first.get(each.message, each.criterion)
        message = each.message if each.passed or where == each.criterion else f'see {where}'
        yield Text(each.criterion), Text(points, style=colour), Text(message)


def _cells(stretch: Stretch) -> tuple[Text, ...]:
    return (
        Text(f'{stretch.start:.0f} m'),
        Text(f'{stretch.theta_deg:g}°'),
        Text(f'{stretch.rms_error:.3f} m/s'),
        Text(f'{stretch.max_error:.3f} m/s'),
        Text(stretch.remark),
    )


def _print_table(console: Console, header: Sequence[str], rows: Iterable[tuple[Text, ...]]) -> None:
    """Print a table; the first and the last column are text, the others numbers."""
    table = Table(*header, box=None, pad_edge=False, show_header=console.is_terminal)
    for column in table.columns[:-1]:
        column.no_wrap = True
    for column in table.columns[1:-1]:
        column.justify = 'right'
    for cells in rows:
        table.add_row(*cells)
    with console.capture() as printed:
        console.print(table)
    for line in printed.get().splitlines():
        console.out(line.rstrip(), highlight=False)


def _print_output(printed: str, console: Console) -> None:
    if not printed:
        return
    _plain(console, 'your code printed:')
    lines = printed.splitlines()
    for line in lines[:_LINES]:
        _plain(console, f'  {one_line(line, _WIDTH)}')
    if lines[_LINES:]:
        _plain(console, '  … and more')


def _plain(console: Console, text: str) -> None:
    """Print `text` without markup."""
    console.print(Text(text), soft_wrap=not console.is_terminal)
