"""Prints the findings in a terminal."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.check.findings import Finding
    from barc_sim.lab.check.worker import Printed, Report
    from barc_sim.lab.grade.rubric import Rubric


_HEADER = ('from', 'grade', 'RMS', 'at most', 'cause')
_LINES = 5  #: of the text that user code printed


def print_report(report: Report, rubric: Rubric, console: Console | None = None) -> None:
    """Print a report: tables in a terminal, one line for each finding in a pipe."""
    console = console or Console(highlight=False)
    worth = rubric.worth(report.findings)
    findings = _without_repeats([each for each in report.findings if each.criterion in worth])
    stretches = _stretches(report.findings)
    if console.is_terminal:
        console.print(_table(findings, rubric))
        if stretches:
            console.print(_stretch_table(stretches))
    else:
        for finding in findings:
            points = _points(finding, rubric)
            _plain(console, f'{finding.criterion:18} {points:>12}  {finding.message}')
        for cells in (_HEADER, *map(_cells, stretches)) if stretches else ():
            _plain(console, '  '.join(cells))
    if report.gains:
        _plain(console, f'gains: {report.gains}')
    if report.tolerated:
        _plain(console, f'tolerated: {"; ".join(report.tolerated)}')
    _print_output(report.printed, console)
    judged = [finding for finding in report.findings if not finding.skipped]
    passed = sum(finding.passed for finding in judged)
    total = round(sum(rubric.points_for(finding) for finding in findings), 2)
    greatest = round(sum(worth.values()), 2)
    _plain(
        console,
        f'{passed} of {len(judged)} criteria are met in full: {total:g} of {greatest:g} points',
    )


def _without_repeats(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings; a repeated message becomes a reference to its first criterion."""
    first = {each.message: each.criterion for each in reversed(findings) if not each.passed}
    where = [first.get(each.message, each.criterion) for each in findings]
    return [
        each if each.passed or name == each.criterion else replace(each, message=f'see {name}')
        for each, name in zip(findings, where, strict=True)
    ]


def _stretches(findings: Sequence[Finding]) -> list[Mapping[str, Any]]:
    details = (finding.details for finding in findings)
    found = next((each['stretches'] for each in details if 'stretches' in each), [])
    return cast('list[Mapping[str, Any]]', found)


def _points(finding: Finding, rubric: Rubric) -> str:
    return f'{rubric.points_for(finding):g} / {rubric.points[finding.criterion]:g}'


def _table(findings: Sequence[Finding], rubric: Rubric) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column('criterion', no_wrap=True)
    table.add_column('points', justify='right', no_wrap=True)
    table.add_column('finding')
    for finding in findings:
        colour = 'dim' if finding.skipped else 'green' if finding.passed else 'red'
        points = Text(_points(finding, rubric), style=colour)
        table.add_row(finding.criterion, points, Text(finding.message))
    return table


def _stretch_table(stretches: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, title="the lab's road, stretch by stretch")
    table.title_justify = 'left'
    *numbers, cause = _HEADER
    for name in numbers:
        table.add_column(name, justify='right', no_wrap=True)
    table.add_column(cause)
    for stretch in stretches:
        table.add_row(*(Text(cell) for cell in _cells(stretch)))
    return table


def _cells(stretch: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        f'{stretch["start"]:.0f} m',
        f'{stretch["theta_deg"]:g}°',
        f'{stretch["rms_error"]:.3f} m/s',
        f'{stretch["max_error"]:.3f} m/s',
        stretch['cause'],
    )


def _print_output(printed: Printed, console: Console) -> None:
    if not printed.text:
        return
    _plain(console, 'your code printed:')
    lines = printed.text.splitlines()
    for line in lines[:_LINES]:
        _plain(console, f'  {line}')
    if more := printed.dropped + len(lines[_LINES:]):
        _plain(console, f'  … and {more:,} more lines')


def _plain(console: Console, text: str) -> None:
    """Print `text` without markup."""
    console.print(Text(text), soft_wrap=not console.is_terminal)
