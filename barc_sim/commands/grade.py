"""Grades submissions, one or many, each in a confined process of its own."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.files import make_folder, saving
from barc_sim.cli.parser import number, whole
from barc_sim.cli.process import INTERRUPTED
from barc_sim.cli.signals import uninterrupted
from barc_sim.errors import UserError
from barc_sim.lab.handout import RUBRICS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Iterator

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.grade.grade import Failure, Report

    _Outcome = tuple[Path, Report | Failure]

_CLASS = 'class.csv'
_EVERY = 10.0  # [s] between two lines on the progress


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Grade submissions: results.json (for Gradescope) and report.html for each, '
        'class.csv for all. Their code can read only Python, NumPy and its own files; it cannot '
        'write files, start processes or use the network.'
    )
    parser.add_argument(
        'submissions',
        type=Path,
        metavar='SUBMISSIONS',
        help='a submission: a folder, .zip or .tar.gz; or a folder of those',
    )
    rubrics = Path(__file__).parents[1] / 'lab' / 'grade' / 'rubrics'
    parser.add_argument(
        '--rubric',
        default=RUBRICS[0],
        metavar='RUBRIC',
        help=f'the points: {", ".join(RUBRICS)} or a file like those in {rubrics} (%(default)s)',
    )
    parser.add_argument(
        '--out', type=Path, default=Path('grades'), metavar='DIR', help='(%(default)s)'
    )
    parser.add_argument('--seed', type=whole(0), metavar='N', help="in place of the rubric's")
    parser.add_argument(
        '--jobs', type=whole(1), metavar='N', help='how many at once (one for each core)'
    )
    parser.add_argument(
        '--time-limit',
        type=number(1.0, 86_400.0),
        default=120.0,
        metavar='S',
        help="for all calls of a submission's code, sleeps included (%(default)g s)",
    )
    parser.add_argument(
        '--unconfined',
        action='store_true',
        help='run the code unconfined, where the system cannot confine it (not Linux, or a kernel '
        'without Landlock): it has your rights; the reports name that',
    )


def run(options: Namespace) -> int:
    """Write the reports and print the table; return the exit code.

    Raises
    ------
    UserError
        where there is nothing to grade, the code cannot be confined, or no report can be written.
    """
    from rich.console import Console  # noqa: PLC0415 (slow: not for --help)

    from barc_sim.lab.confined.process import Limits, check  # noqa: PLC0415
    from barc_sim.lab.grade import grade, rubric, similarity, submissions, summary  # noqa: PLC0415
    from barc_sim.tuning.workers import cores  # noqa: PLC0415

    points = rubric.load(options.rubric)
    if options.seed is not None:
        points = replace(points, seed=options.seed)
    out = options.out.absolute()
    paths = [path for path in submissions.find(options.submissions) if path.absolute() != out]
    check(sandbox=not options.unconfined)
    jobs = options.jobs or cores()
    with (
        grade.processes(jobs) as executor,
        grade.run(
            executor,
            paths,
            points,
            Limits(total=options.time_limit),
            at_once=jobs + 1,
            sandbox=not options.unconfined,
        ) as outcomes,
    ):
        # Gradescope looks for the files of a single submission in the folder itself.
        alone = paths == [options.submissions.resolve()]
        folders = {path: out if alone else _folder(out, path) for path in paths}
        reports, failures, interrupted = _collect(outcomes, out, folders)
    alike = similarity.alike({report.name: report.passages for report in reports})
    _write(out, out / _CLASS, summary.as_csv(reports, failures, points, alike).encode())
    console = Console()
    console.print(summary.as_table(reports, points))
    if len(folders) > 1:
        for table in summary.overview(reports, failures, points, alike):
            console.print()
            console.print(table)
    print(out)  # noqa: T201
    for name, failure in failures.items():
        print(f'barc grade: {name} could not be graded: {failure.reason}', file=sys.stderr)  # noqa: T201
    if interrupted:
        return INTERRUPTED
    return 1 if failures else 0


def _folder(out: Path, submission: Path) -> Path:
    """Return the folder of a submission's reports; none has the class's list for its name."""
    name = submission.name
    return out / (f'{name}.submission' if name == _CLASS else name)


def _collect(
    outcomes: Iterable[_Outcome], out: Path, folders: dict[Path, Path]
) -> tuple[list[Report], dict[str, Failure], bool]:
    """Write the files of each submission as it finishes; also return whether Ctrl-C came."""
    from barc_sim.lab.grade.grade import Report  # noqa: PLC0415

    reports: list[Report] = []
    failures: dict[str, Failure] = {}
    try:
        for path, outcome in with_progress(outcomes, len(folders)):
            if isinstance(outcome, Report):
                with uninterrupted():  # a submission has all of its files, and a row, or none
                    for name, data in outcome.files.items():
                        _write(out, folders[path] / name, data)
                    reports.append(outcome._replace(files={}))
            else:
                failures[path.name] = outcome
    except KeyboardInterrupt:
        return reports, failures, True
    return reports, failures, False


def with_progress(outcomes: Iterable[_Outcome], total: int) -> Iterator[_Outcome]:
    """Yield the outcomes; show on stderr how many there are, and the time left.

    That is a bar in a terminal, and a line every `_EVERY` seconds elsewhere.
    """
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn  # noqa: PLC0415

    console = Console(stderr=True)
    if console.is_terminal:
        columns = ('Grading', BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console, transient=True) as progress:
            yield from progress.track(outcomes, total=total)
        return
    began = printed = time.monotonic()
    for count, outcome in enumerate(outcomes, 1):
        yield outcome
        now = time.monotonic()
        if now - printed >= _EVERY and count < total:
            printed = now
            left = (now - began) / count * (total - count)
            print(f'graded {count} of {total}, {left:.0f} s left', file=sys.stderr, flush=True)  # noqa: T201


def _write(out: Path, path: Path, data: bytes) -> None:
    """Write a file in a folder of `out`, whole or not at all."""
    try:
        make_folder(path.parent, out)
    except OSError as error:
        raise UserError(
            f'cannot write {str(path)!r}: {error.strerror}; choose another place with --out'
        ) from None
    with saving(path, '--out') as part:
        part.write_bytes(data)
