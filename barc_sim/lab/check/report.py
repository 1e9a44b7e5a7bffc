"""Tells a user in the terminal what was found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.check.finding import Finding
    from barc_sim.lab.check.worker import Prints, Report


_LINES = 5  #: of what the code printed


def tell(report: Report, console: Console | None = None) -> None:
    """Print a report: tables in a terminal, a line for each finding into a pipe."""
    console = console or Console(highlight=False)
    findings = _once(report.findings)
    stretches = _stretches(report.findings)
    if console.is_terminal:
        console.print(_table(findings))
        if stretches:
            console.print(_stretch_table(stretches))
    else:
        for finding in findings:
            _plain(console, f'{finding.criterion:18} {_score(finding):>6}  {finding.message}')
        for stretch in stretches:
            _plain(console, '  '.join(_cells(stretch)))
    _tell_prints(report.prints, console)
    judged = [finding for finding in report.findings if not finding.skipped]
    passed = sum(finding.passed for finding in judged)
    _plain(console, f'{passed} of {len(judged)} criteria are met in full')


def _once(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings with a cause named where it is found first."""
    first: dict[str, str] = {}
    told = []
    for finding in findings:
        if finding.passed:
            told.append(finding)
            continue
        where = first.setdefault(finding.message, finding.criterion)
        same = where != finding.criterion
        told.append(replace(finding, message=f'as {where}') if same else finding)
    return told


def _stretches(findings: Sequence[Finding]) -> list[Mapping[str, Any]]:
    for finding in findings:
        if 'stretches' in finding.details:
            return cast('list[Mapping[str, Any]]', finding.details['stretches'])
    return []


def _score(finding: Finding) -> str:
    # Rounded down: what is not met in full does not look as if it were.
    return '-' if finding.skipped else f'{int(finding.score * 1000) / 10:g} %'


def _table(findings: Sequence[Finding]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column('criterion', no_wrap=True)
    table.add_column('score', justify='right', no_wrap=True)
    table.add_column('what was found')
    for finding in findings:
        colour = 'dim' if finding.skipped else 'green' if finding.passed else 'red'
        table.add_row(finding.criterion, Text(_score(finding), style=colour), Text(finding.message))
    return table


def _stretch_table(stretches: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, title="the lab's road, stretch by stretch")
    table.title_justify = 'left'
    for name in ('from', 'grade', 'RMS', 'at most'):
        table.add_column(name, justify='right', no_wrap=True)
    table.add_column('why')
    for stretch in stretches:
        table.add_row(*(Text(cell) for cell in _cells(stretch)))
    return table


def _cells(stretch: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        f'{stretch["start"]:.0f} m',
        f'{stretch["theta_deg"]:g}°',
        f'{stretch["rms_error"]:.3f} m/s',
        f'{stretch["max_error"]:.3f} m/s',
        stretch['why'],
    )


def _tell_prints(prints: Prints, console: Console) -> None:
    if not prints.text:
        return
    _plain(console, 'your code printed:')
    lines = prints.text.splitlines()
    for line in lines[:_LINES]:
        _plain(console, f'  {line}')
    if more := prints.dropped + len(lines[_LINES:]):
        _plain(console, f'  … and {more:,} lines more')


def _plain(console: Console, text: str) -> None:
    """Print `text` as it is: what a user prints is no markup."""
    console.print(Text(text), soft_wrap=True)
