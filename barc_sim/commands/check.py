"""Finds mistakes in a user's files for a lab, and names their causes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import FIGURES, target
from barc_sim.cli.text import one_line
from barc_sim.errors import UserError, escaped
from barc_sim.lab.files import RUBRICS, find_files, handout_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Sequence

    from rich.console import Console
    from rich.text import Text

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.grade.grade import Rubric
    from barc_sim.lab.judge import Finding, JudgedFolder

NOT_PASSED = 1
_PIPE = 10_000  #: columns: a line is never broken
#: How many lines of the text that user code printed are shown, and how many characters of each.
_LINES = 5
_WIDTH = 100
#: In what two calls that fail alike differ: where on the road, what was passed, with which gains.
_CALL = re.compile(
    r'^call \d+, after [\d.]+ s on the road: |\(\w+=[-\[\d][^()]*\)| \(with kp .*\)$'
)


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Check your files for a lab: compare each function with the right results, drive with '
        'them, and name mistakes with their causes. For the hills lab it also runs compose.py.'
    )
    parser.epilog = 'Exit code 0: everything is right; 1: something is not.'
    parser.add_argument('folder', type=Path, metavar='LAB', help='the folder with your files')
    parser.add_argument(
        '--rubric',
        metavar='RUBRIC',
        help=f'the points, as in grade: {", ".join(RUBRICS)} or a file (the default of the '
        "folder's lab)",
    )
    parser.add_argument(
        '--save', metavar='FILE', help='save the figure as .png, .pdf or .svg (LAB/check.png)'
    )
    parser.add_argument('--no-plot', action='store_true', help='draw no figure')


def run(options: Namespace) -> int:
    """Print and draw the findings; return 1 if any of them is a mistake.

    UserError: there is nothing to check, or the figure cannot be saved.
    """
    from barc_sim.lab.grade.grade import load_rubric  # noqa: PLC0415

    if options.save is not None and options.no_plot:
        raise UserError('--save and --no-plot contradict each other: give one of them')
    folder = options.folder
    if folder.is_file() and folder.suffix == '.py':
        folder = folder.parent
    name = options.save or str(folder / 'check.png')
    path = None if options.no_plot else target(name, FIGURES)

    parts = find_files(folder)  # or a UserError
    rubric = load_rubric(options.rubric or handout_of(parts).rubric)
    rubric.lab.check_packages()
    files = rubric.lab.handout.files
    if parts.keys().isdisjoint(files):
        raise UserError(
            f'the rubric {options.rubric!r} judges {", ".join(files.values())}: the folder '
            f'{str(folder)!r} has none of them'
        )

    judged = rubric.lab.judge_folder(folder, rubric.settings)
    print_findings(judged, rubric)
    is_composed = _composition(folder)

    if path and judged.drive:
        from barc_sim.figures.files import save_figure  # noqa: PLC0415 (slow: not for --help)

        title = escaped(f'{folder.resolve().name}: {judged.gains or rubric.title}')
        save_figure(path, judged.drive.figure(title))

    is_right = all(each.passed or each.skipped or each.open for each in judged.findings)
    return 0 if is_composed and is_right else NOT_PASSED


def _composition(folder: Path) -> bool:
    """Judge a `compose.py` in the folder, and print the result; return whether it is right."""
    from barc_sim.lab.files import COMPOSE  # noqa: PLC0415

    file = folder / COMPOSE
    if not file.is_file():
        return True
    from barc_sim.runs.compose_check import judge_composition  # noqa: PLC0415 (slow)

    verdict = judge_composition(file)
    names_file = verdict.sentence.startswith(COMPOSE)
    print(verdict.sentence if names_file else f'{COMPOSE}: {verdict.sentence}')  # noqa: T201
    return verdict.right


def print_findings(judged: JudgedFolder, rubric: Rubric, console: Console | None = None) -> None:
    """Print the findings in a terminal, or a line for each in a pipe."""
    from rich.console import Console  # noqa: PLC0415 (slow: not for --help)
    from rich.text import Text  # noqa: PLC0415

    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.width = _PIPE

    worth = rubric.worth(judged.findings)
    findings = [each for each in judged.findings if each.criterion in worth]
    _print_table(console, ('criterion', 'points', 'finding'), _rows(findings, rubric))
    if judged.drive:
        _plain(console, judged.drive.title)
        rows = (map(Text, cells) for cells in judged.drive.rows)
        _print_table(console, judged.drive.header, rows)
    if judged.gains:
        _plain(console, f'gains: {judged.gains}')
    if judged.tolerated:
        _plain(console, f'tolerated: {"; ".join(judged.tolerated)}')
    _print_output(judged.printed, console)

    closed = [finding for finding in findings if not finding.open]
    passed = sum(finding.passed for finding in closed)
    points = round(sum(rubric.points_for(finding) for finding in findings), 2)
    possible = round(sum(worth.values()), 2)
    text = f'{passed} of {len(closed)} criteria are met in full: {points:g} of {possible:g} points'
    still_open = sum(worth[finding.criterion] for finding in findings if finding.open)
    if still_open:
        text += f', {still_open:g} still open'
    _plain(console, text)


def _rows(findings: Sequence[Finding], rubric: Rubric) -> Iterable[tuple[Text, ...]]:
    """Yield the cells of each finding; a repeated message refers to its first criterion."""
    from rich.text import Text  # noqa: PLC0415

    first: dict[str, str] = {}  # criterion, by message
    for finding in findings:
        if not finding.passed:
            first.setdefault(_CALL.sub('', finding.message), finding.criterion)

    for finding in findings:
        if finding.skipped or finding.open:
            colour = 'dim'
        elif finding.passed:
            colour = 'green'
        else:
            colour = 'red'
        points = 'open' if finding.open else f'{rubric.points_for(finding):g}'
        points = f'{points} / {rubric.points[finding.criterion]:g}'
        message = finding.message
        if not finding.passed:
            where = first[_CALL.sub('', message)]
            message = message if where == finding.criterion else f'see {where}'
        yield Text(finding.criterion), Text(points, style=colour), Text(message)


def _print_table(console: Console, header: Sequence[str], rows: Iterable[Iterable[Text]]) -> None:
    """Print a table; the first and the last column are text, the others numbers."""
    from rich.table import Table  # noqa: PLC0415

    table = Table(*header, box=None, pad_edge=False)
    for column in table.columns[:-1]:
        column.no_wrap = True
    table.columns[-1].overflow = 'fold'
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
    console.print(text, markup=False, emoji=False, soft_wrap=not console.is_terminal)
