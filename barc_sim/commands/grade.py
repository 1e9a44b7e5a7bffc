"""Grades submissions, one or many, each in a confined process of its own."""

from __future__ import annotations

import re
import sys
from concurrent.futures import Future
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.files import make_folder, saving
from barc_sim.cli.parser import INTERRUPTED, number
from barc_sim.cli.process import StopSignals
from barc_sim.errors import UserError, escaped
from barc_sim.lab.files import BY_HAND, RUBRICS, handout_of, names_of
from barc_sim.parallel.options import add_executor_options, executor_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Iterator
    from concurrent.futures import Executor

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.confined.process import ProcessLimits
    from barc_sim.lab.grade.grade import ByHand, Grade, Rubric
    from barc_sim.lab.submission import Submission

    _Outcome = tuple[Path, Grade | str]

#: The files of a class, and what submissions of these names get.
_OF_CLASS = re.compile(r'(class\.csv|class\.html|canvas\.csv)(\.submission)*')
_MAX_NAME = 255  # bytes of a folder's name
# Of a longer one: the characters of the name, and of its hash.
_KEPT = 50
_DIGITS = 32
_SHORTENED = re.compile(f'~[0-9a-f]{{{_DIGITS}}}$')


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Grade submissions: results.json (for Gradescope) and report.html for each, class.html and '
        'class.csv for all. Points and comments in by_hand.yaml beside a report are kept. The '
        "submissions' code can read only Python, NumPy and its own files; it cannot write files, "
        'start processes or use the network.'
    )
    parser.add_argument(
        'submissions',
        type=Path,
        metavar='SUBMISSIONS',
        help='a submission, which is a folder or .zip, or a folder of submissions',
    )
    rubrics = Path(__file__).parents[1] / 'lab' / 'grade' / 'rubrics'
    parser.add_argument(
        '--rubric',
        metavar='RUBRIC',
        help=f'the points: {", ".join(RUBRICS)} or a file like those in {rubrics} (the default '
        'of the lab of the first submission with code)',
    )
    parser.add_argument(
        '--out', type=Path, default=Path('grades'), metavar='DIR', help='reports (%(default)s)'
    )
    parser.add_argument(
        '--roster',
        type=Path,
        metavar='FILE',
        help='list of students: a CSV file with name, id and section, as Canvas and Gradescope '
        'export it; folders are matched by id or name, and canvas.csv is written',
    )
    add_executor_options(parser, 'submissions')
    parser.add_argument(
        '--time-limit',
        type=number(1.0, 86_400.0),
        default=120.0,
        metavar='S',
        help="maximum time for all calls of a submission's code, sleeps included (%(default)g s)",
    )
    parser.add_argument(
        '--unconfined',
        action='store_true',
        help='run the code with your rights if the system cannot confine it (not Linux, or a '
        'kernel without Landlock); the reports name that',
    )


def run(options: Namespace) -> int:
    """Write the reports and print the score; return the exit code."""
    from barc_sim.lab import submission  # noqa: PLC0415
    from barc_sim.lab.confined.process import ProcessLimits, check_confinement  # noqa: PLC0415
    from barc_sim.lab.grade import classroom, grade  # noqa: PLC0415

    out = options.out.absolute()
    if out.resolve() == options.submissions.resolve():
        raise UserError(f'{str(options.out)!r} has the submissions: name another folder with --out')

    submissions = submission.find(options.submissions, is_class=bool(options.roster))
    paths = [path for path in map(Path.absolute, submissions) if path != out]
    rubric = grade.load_rubric(options.rubric or _rubric_of(paths))
    rubric.lab.check_packages()
    # Gradescope looks for the files of a single submission in the folder itself.
    is_single = paths == [options.submissions.resolve()]
    students = classroom.read_roster(options.roster) if options.roster else []
    folders = {path: out if is_single else _folder(out, path) for path in paths}
    entered_points = {path: grade.entered(folder, rubric) for path, folder in folders.items()}
    blank_form = grade.nothing_entered(rubric).encode()

    limits = ProcessLimits(total=options.time_limit, confined=not options.unconfined)
    if options.scheduler is None:
        check_confinement(limits)
    stopped: Future[Any] = Future()
    check = partial(_confinement_fault, limits)
    # Each is read here, within limits, when a worker is free: what travels are the files that are
    # graded, without plots and bags.
    jobs = (
        GradingJob(path, submission.read_submission(path), by_hand, rubric, limits)
        for path, by_hand in entered_points.items()
    )
    with StopSignals() as stop, executor_of(options, check) as executor:
        stop.then(partial(stopped.set_result, None))
        outcomes = grade_all(executor, stopped, jobs)
        grades, failures = _collect(outcomes, out, folders, blank_form)
    graded = len(grades) + len(failures)
    if graded < len(paths):
        text = f'{graded} of {len(paths)} are graded; the files of the class stay as they were'
        print(f'barc grade: interrupted: {text}', file=sys.stderr)  # noqa: T201
        return INTERRUPTED

    names = {path: folder.name for path, folder in folders.items()}
    entries = classroom.entries(
        {names[path]: grade for path, grade in grades.items()},
        {names[path]: failure for path, failure in failures.items()},
        students,
    )
    files = {}
    if not is_single:
        files['class.csv'] = classroom.as_csv(entries, rubric)
        files['class.html'] = classroom.class_page(entries, rubric)
        if students:
            files['canvas.csv'] = classroom.canvas(entries, rubric)
    for name, text in files.items():
        _write(out, out / name, text.encode())

    lines = classroom.summary([*grades.values()], rubric)
    print('\n'.join([*lines, str(out if is_single else out / 'class.html')]))  # noqa: T201
    for path in sorted(failures):
        text = f'{escaped(path.name)} could not be graded: {failures[path]}'
        print(f'barc grade: {text}', file=sys.stderr)  # noqa: T201
    if stopped.done():
        return INTERRUPTED
    return 1 if failures else 0


def _rubric_of(paths: Iterable[Path]) -> str:
    """Return the usual rubric of the lab of the first submission that has a file of one."""
    from barc_sim.lab.submission import read_submission  # noqa: PLC0415

    for path in paths:
        names = names_of(read_submission(path).files)
        if names:
            return handout_of(names).rubric
    return handout_of(()).rubric


def _folder(out: Path, submission: Path) -> Path:
    """Return the folder for a submission's reports; no other submission, and no class, has it.

    It depends on the submission's name alone, so that points by hand stay with their submission.
    """
    # A backslash stands for a byte that is not UTF-8, so one in a name is doubled.
    name = submission.name.replace('\\', r'\\').encode(errors='backslashreplace').decode()
    if _OF_CLASS.fullmatch(name):
        name += '.submission'
    if len(name.encode()) > _MAX_NAME or _SHORTENED.search(name):
        name = f'{name[:_KEPT]}~{sha256(name.encode()).hexdigest()[:_DIGITS]}'
    return out / name


def _collect(
    outcomes: Iterable[_Outcome], out: Path, folders: dict[Path, Path], blank_form: bytes
) -> tuple[dict[Path, Grade], dict[Path, str]]:
    """Write the files of each submission as it finishes; return grades and failures.

    The file for points by hand is written as `blank_form` if there is none.
    """
    from rich.console import Console  # noqa: PLC0415 (slow: not for --help)
    from rich.progress import track  # noqa: PLC0415

    stderr = Console(stderr=True)
    grades: dict[Path, Grade] = {}
    failures: dict[Path, str] = {}
    if stderr.is_terminal:  # elsewhere rich before 15 prints an empty line
        outcomes = track(outcomes, 'Grading', len(folders), console=stderr, transient=True)

    for path, outcome in outcomes:
        folder = folders[path]
        if isinstance(outcome, str):
            failures[path] = outcome
            continue
        files = dict(outcome.files)
        is_single = folder == out
        if not is_single and not (folder / BY_HAND).exists():
            files[BY_HAND] = blank_form
        for name, data in files.items():
            _write(out, folder / name, data)
        grades[path] = outcome._replace(files={})
    return grades, failures


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


class GradingJob(NamedTuple):
    """A submission, and all that a worker needs to grade it."""

    path: Path
    submission: Submission
    by_hand: ByHand
    rubric: Rubric
    limits: ProcessLimits


def grade_all(
    executor: Executor, stopped: Future[Any], jobs: Iterable[GradingJob]
) -> Iterator[_Outcome]:
    """Yield each submission, as it finishes, with its grade or the grader's error.

    It ends early when `stopped` is done.
    """
    from barc_sim.parallel.pieces import finished_pieces  # noqa: PLC0415 (slow: not for --help)

    for job, future in finished_pieces(executor, _grade, jobs, stopped):
        error = future.exception()
        if error is None:
            yield job.path, future.result()
        elif isinstance(error, UserError):
            yield job.path, str(error)
        else:
            yield job.path, f'{type(error).__name__}: {error}'


def _grade(job: GradingJob) -> Grade:
    """Return the grade of a submission; called by workers."""
    from barc_sim.lab.grade.grade import report  # noqa: PLC0415

    return report(job.submission, job.by_hand, job.rubric, job.limits)


def _confinement_fault(limits: ProcessLimits) -> str:
    """Return why a worker cannot confine a submission; empty if it can."""
    from barc_sim.lab.confined.process import check_confinement  # noqa: PLC0415

    try:
        check_confinement(limits)
    except UserError as error:
        return str(error)
    return ''
