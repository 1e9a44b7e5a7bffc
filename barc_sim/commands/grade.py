"""Grades submissions, one or many, each in a confined process of its own."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentTypeError
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.files import make_folder, read_regular, saving
from barc_sim.cli.parser import number, whole
from barc_sim.cli.process import INTERRUPTED
from barc_sim.cli.signals import uninterrupted
from barc_sim.errors import UserError
from barc_sim.lab.handout import BY_HAND, RUBRICS

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable

    from barc_sim.cli.parser import Parser
    from barc_sim.lab.grade.by_hand import ByHand
    from barc_sim.lab.grade.grade import Failure, Report
    from barc_sim.lab.grade.roster import Student
    from barc_sim.lab.grade.rubric import Rubric

    _Outcome = tuple[Path, Report | Failure]

_CLASS, _SETTINGS, _RECORD = 'class.csv', 'class.json', 'record.json'
_RESERVED = {_CLASS, _SETTINGS, 'class.html', 'canvas.csv', 'gradescope.csv'}
_AGAIN = 'look at the points by hand again'
_MAX_BYTES = 4 << 20  # of a file that this command has written


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Grade submissions: results.json (for Gradescope) and report.html for each, class.html and '
        'class.csv for all. Points and comments in by_hand.yaml beside a report are kept. Their '
        'code can read only Python, NumPy and its own files; it cannot write files, start '
        'processes or use the network.'
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
    parser.add_argument(
        '--roster',
        type=Path,
        metavar='FILE',
        help='the students, a CSV file with name, id and section, as Canvas and Gradescope write '
        'it: matches folders by id or name, and writes canvas.csv and gradescope.csv',
    )
    parser.add_argument(
        '--due', type=moment, metavar='TIME', help='such as 2026-11-20T23:59: names who is late'
    )
    parser.add_argument(
        '--handout',
        type=Path,
        metavar='DIR',
        help='what you gave to the students: its code is no sign of a copy',
    )
    parser.epilog = (
        'A class in DIR keeps its roster, due time and handout: they need not be given again. '
        'One of its folders can be graded alone.'
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
    from barc_sim.lab.grade import classroom, grade, rubric, submissions  # noqa: PLC0415
    from barc_sim.tuning.workers import cores  # noqa: PLC0415

    points = rubric.load(options.rubric)
    if options.seed is not None:
        points = replace(points, seed=options.seed)
    out = options.out.absolute()
    paths = [path for path in submissions.find(options.submissions) if path.absolute() != out]
    # Gradescope looks for the files of a single submission in the folder itself.
    alone = paths == [options.submissions.resolve()] and not (out / _SETTINGS).exists()
    settings = _Settings.of(options, out)
    folders = {path: out if alone else _folder(out, path) for path in paths}
    before = {} if alone else _records(out)
    entered = _entered(folders, before, settings, points)
    check(sandbox=not options.unconfined)
    with grade.processes(options.jobs or cores()) as executor:
        outcomes = grade.run(
            executor,
            {path: hand for path, (hand, _) in entered.items()},
            points,
            Limits(total=options.time_limit),
            sandbox=not options.unconfined,
        )
        reports, failures, interrupted = _collect(outcomes, out, folders, entered, before)
    found = classroom.entries(
        before | reports, failures, settings.students, settings.due, settings.passages
    )
    _write(out, out / _CLASS, classroom.as_csv(found, points).encode())
    console = Console()
    if not alone:
        files = {'class.html': classroom.page(found, points)}
        files |= classroom.gradebooks(found, points) if settings.students else {}
        for name, text in files.items():
            _write(out, out / name, text.encode())
        _write(out, out / _SETTINGS, settings.as_json())
    counted = [each.report for each in found if each.report and not each.newer]
    console.print(classroom.as_table([*reports.values()] if len(paths) == 1 else counted, points))
    print(out if alone else out / 'class.html')  # noqa: T201
    for name, failure in failures.items():
        print(f'barc grade: {name} could not be graded: {failure.reason}', file=sys.stderr)  # noqa: T201
    if interrupted:
        return INTERRUPTED
    return 1 if failures else 0


class _Settings(NamedTuple):
    """What a class keeps for the next time: options that are not given again stay."""

    roster: Path | None
    due: datetime | None
    handout: Path | None
    students: list[Student]
    passages: frozenset[int]  #: of the handout

    @classmethod
    def of(cls, options: Namespace, out: Path) -> _Settings:
        """Return the options' settings, else those of the class in `out`."""
        from barc_sim.lab.grade import roster, similarity, submissions  # noqa: PLC0415

        try:
            kept = json.loads(read_regular(out / _SETTINGS, _MAX_BYTES))
        except (OSError, ValueError):
            kept = {}
        list_ = options.roster or (Path(kept['roster']) if 'roster' in kept else None)
        handout = options.handout or (Path(kept['handout']) if 'handout' in kept else None)
        due = options.due or (moment(kept['due']) if 'due' in kept else None)
        students = roster.read(list_) if list_ else []
        files = submissions.read(handout).files if handout else {}
        return cls(list_, due, handout, students, similarity.passages(files))

    def as_json(self) -> bytes:
        """Return the options as JSON."""
        paths = {name: getattr(self, name) for name in ('roster', 'handout')}
        kept: dict[str, str] = {name: str(path.absolute()) for name, path in paths.items() if path}
        return json.dumps(kept | ({'due': self.due.isoformat()} if self.due else {})).encode()


def moment(text: str) -> datetime:
    """Return a date and time, in the zone of this machine where it has none."""
    try:
        return datetime.fromisoformat(text).astimezone()
    except ValueError:
        raise ArgumentTypeError(
            f'{text!r} is no date: expected one such as 2026-11-20T23:59'
        ) from None


def _folder(out: Path, submission: Path) -> Path:
    """Return the folder of a submission's reports; none has the name of a file of the class."""
    name = submission.name
    return out / (f'{name}.submission' if name in _RESERVED else name)


def _records(out: Path) -> dict[str, Report]:
    """Return what was graded before, by folder."""
    from barc_sim.lab.grade.grade import from_record  # noqa: PLC0415

    files = sorted(out.glob(f'*/{_RECORD}'))
    return {file.parent.name: from_record(read_regular(file, _MAX_BYTES)) for file in files}


def _entered(
    folders: dict[Path, Path], before: dict[str, Report], settings: _Settings, points: Rubric
) -> dict[Path, tuple[ByHand, Path]]:
    """Return what is entered by hand for each submission, and the folder that it is from.

    For one that is new, that is an earlier folder of the same student.
    """
    from barc_sim.lab.grade import by_hand  # noqa: PLC0415
    from barc_sim.lab.grade.roster import owner  # noqa: PLC0415

    found = {}
    for path, folder in folders.items():
        hand, source = by_hand.read(folder, points), folder
        student = owner(path.name, settings.students)
        if not hand and student:
            for name in before:
                other = folder.with_name(name)
                if owner(name, settings.students) is student and not hand:
                    hand, source = by_hand.read(other, points), other
        found[path] = hand, source
    return found


def _collect(
    outcomes: Iterable[_Outcome],
    out: Path,
    folders: dict[Path, Path],
    entered: dict[Path, tuple[ByHand, Path]],
    before: dict[str, Report],
) -> tuple[dict[str, Report], dict[str, Failure], bool]:
    """Write the files of each submission as it finishes; also return whether Ctrl-C came."""
    from rich.console import Console  # noqa: PLC0415 (slow: not for --help)
    from rich.progress import track  # noqa: PLC0415

    from barc_sim.lab.grade.grade import Report  # noqa: PLC0415

    stderr = Console(stderr=True)
    reports: dict[str, Report] = {}
    failures: dict[str, Failure] = {}
    try:
        for path, outcome in track(
            outcomes, 'Grading', len(folders), console=stderr, transient=True
        ):
            folder = folders[path]
            if not isinstance(outcome, Report):
                failures[folder.name] = outcome
                continue
            source = entered[path][1]
            note = _look_again(source, before.get(source.name), outcome)
            report = outcome._replace(notes=(*outcome.notes, *note), files={})
            with uninterrupted():  # a submission has all of its files, and a row, or none
                for name, data in outcome.files.items():
                    if name != BY_HAND:
                        _write(out, folder / name, data)
                    elif folder != out and (not report.is_by_hand or source != folder):
                        mine = (
                            read_regular(source / name, _MAX_BYTES) if report.is_by_hand else data
                        )
                        _write(out, folder / name, mine)
                if folder != out:
                    _write(out, folder / _RECORD, report.record())
                reports[folder.name] = report
    except KeyboardInterrupt:
        return reports, failures, True
    return reports, failures, False


def _look_again(source: Path, prior: Report | None, report: Report) -> list[str]:
    """Return a note where points were entered for other code, until the file is edited again."""
    if not (report.is_by_hand and prior):
        return []
    edited = (source / BY_HAND).stat().st_mtime_ns > (source / _RECORD).stat().st_mtime_ns
    if prior.code != report.code:
        return [f'{_AGAIN}: they were entered for {source.name}, and the code has changed']
    return [] if edited else [note for note in prior.notes if note.startswith(_AGAIN)]


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
