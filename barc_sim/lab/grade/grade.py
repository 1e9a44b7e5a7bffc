"""Grades submissions, several at once: weighs the findings, and writes HTML and results.json."""

from __future__ import annotations

import hashlib
import io
import json
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.process import uninterrupted
from barc_sim.errors import UserError, escaped
from barc_sim.lab.files import BY_HAND, data_url, render
from barc_sim.lab.grade.rubric import LABELS
from barc_sim.lab.grade.submissions import graded, read

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from barc_sim.lab.confined.process import Limits
    from barc_sim.lab.grade.rubric import ByHand, Rubric
    from barc_sim.lab.grade.submissions import Submission
    from barc_sim.lab.judge import Evidence


_HEAD = """\
# Yours: barc grade reads this file each time, and keeps what you enter.
# Points that you write replace the computed ones: 4.5, or 4.5 and a comment.
"""
_DPI = 100


class Item(NamedTuple):
    """The points for one criterion."""

    criterion: str
    points: float  #: rounded to hundredths
    max_points: float
    message: str
    open: bool = False  #: it is judged by eye: its points are 0 until they are given by hand
    evidence: Evidence | None = None  #: what the report's figure shows

    @property
    def status(self) -> str:
        """The word of Gradescope for its points."""
        return 'passed' if self.points >= self.max_points else 'failed'


class Grade(NamedTuple):
    """The points of a submission, with its notes and output, and the files of its report."""

    name: str
    title: str  #: the rubric's
    seed: int
    visibility: str
    items: tuple[Item, ...]
    notes: tuple[str, ...] = ()
    printed: str = ''  #: the first output of its code
    hashes: Mapping[str, str] = {}  #: SHA-256, by file
    gains: str = ''  #: that drove the roads, and where they come from
    tolerated: tuple[str, ...] = ()  #: a phrase each
    comment: str = ''  #: of a person
    files: Mapping[str, bytes] = {}  #: by name

    @property
    def score(self) -> float:
        """Return the sum of the items' points."""
        return round(sum(item.points for item in self.items), 2)

    @property
    def max_score(self) -> float:
        """Return the sum of the items' maximum points."""
        return round(sum(item.max_points for item in self.items), 2)

    @property
    def points(self) -> dict[str, float]:
        """Return the points by criterion, without the open ones."""
        return {item.criterion: item.points for item in self.items if not item.open}

    @property
    def open(self) -> dict[str, float]:
        """Return the points of the criteria that are judged by eye."""
        return {item.criterion: item.max_points for item in self.items if item.open}

    @property
    def mistakes(self) -> list[Item]:
        """Return the items that lost points, the most first."""
        lost = [item for item in self.items if item.points < item.max_points and not item.open]
        return sorted(lost, key=lambda item: item.points - item.max_points)

    @property
    def remark(self) -> str:
        """Return the message of the criterion that lost most points."""
        return ''.join(f'{LABELS[item.criterion]}: {item.message}' for item in self.mistakes[:1])


def grade(submission: Submission, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Grade:
    """Judge a submission; its code runs in a separate process and folder.

    A criterion's points are its maximum points times the finding's score, rounded to hundredths.
    """
    notes = submission.notes
    files = graded(submission.files)
    if not files:
        wanted = ' or '.join(rubric.lab.handout.files.values())
        notes = (f'it has no {wanted} at its top', *notes)
    if not sandbox:
        notes = (*notes, 'its code was not confined, as --unconfined asks for')
    with tempfile.TemporaryDirectory(prefix='barc_sim_grade_') as folder:
        submission.write(Path(folder))
        found = rubric.lab.judge_folder(Path(folder), rubric.settings, limits, sandbox=sandbox)
    findings = {finding.criterion: finding for finding in found.findings}
    return Grade(
        name=submission.name,
        title=rubric.title,
        seed=rubric.settings.seed,
        visibility=rubric.visibility,
        items=tuple(
            Item(
                name,
                rubric.points_for(findings[name]),
                worth,
                escaped(findings[name].message),
                findings[name].open,
                findings[name].evidence,
            )
            for name, worth in rubric.worth(findings.values()).items()
        ),
        notes=notes,
        printed=escaped(found.printed),
        hashes={name: hashlib.sha256(submission.files[name]).hexdigest() for name in files},
        gains=escaped(str(found.gains or '')),
        tolerated=tuple(map(escaped, found.tolerated)),
    )


def report(path: Path, hand: ByHand, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Grade:
    """Grade the submission at `path`, with its files; what is entered by hand counts."""
    computed = grade(read(path), rubric, limits, sandbox=sandbox)
    found = _merged(computed, hand, rubric)
    files = {'results.json': gradescope(found).encode(), 'report.html': page(found).encode()}
    if not hand:
        files[BY_HAND] = _empty(computed).encode()
    items = tuple(item._replace(evidence=None) for item in found.items)
    return found._replace(items=items, files=files)


def _merged(grade: Grade, hand: ByHand, rubric: Rubric) -> Grade:
    """Return the grade with what is entered in place of what was computed."""
    items = {item.criterion: item for item in grade.items}
    for name, (points, comment) in hand.points.items():
        computed = items.get(name) or Item(name, 0.0, rubric.points[name], '', open=True)
        was = 'open' if computed.open else f'{computed.points:g}'
        texts = (comment, f'by hand (computed: {was})', computed.message)
        message = '; '.join(filter(None, texts))
        items[name] = computed._replace(points=points, message=message, open=False)
    order = tuple(items[name] for name in rubric.points if name in items)
    return grade._replace(items=order, comment=hand.comment)


def _empty(grade: Grade) -> str:
    """Return the text of a file in which nothing is entered."""
    lines = [
        f'  {item.criterion}:  # {"open" if item.open else f"{item.points:g}"} of '
        f'{item.max_points:g}\n'
        for item in grade.items
    ]
    return f'{_HEAD}comment:\npoints:\n{"".join(lines)}'


def page(grade: Grade) -> str:
    """Return the HTML report, with the runs that were judged as a figure."""
    png = io.BytesIO()
    for runs in filter(None, (item.evidence for item in grade.items)):
        runs.figure('').savefig(png, format='png', dpi=_DPI, metadata={'Software': ''})
    return render(
        'grade',
        grade=grade,
        score=f'{grade.score:g} / {grade.max_score:g}'
        + (f', {sum(grade.open.values()):g} open' if grade.open else ''),
        labels=LABELS,
        figures=data_url('image/png', png.getvalue()) if png.tell() else '',
    )


def gradescope(grade: Grade) -> str:
    """Return the text of Gradescope's `results.json`.

    https://gradescope-autograders.readthedocs.io/en/latest/specs/
    """
    tests = [
        {
            'name': LABELS[item.criterion],
            'number': item.criterion,
            'max_score': item.max_points,
            'output': item.message,
            'output_format': 'text',
            'visibility': grade.visibility,
        }
        # Open ones have none.
        | ({} if item.open else {'score': item.points, 'status': item.status})
        for item in grade.items
    ]
    remarks = {
        'comment': grade.comment,
        'gains': grade.gains,
        'tolerated': '; '.join(grade.tolerated),
    }
    content = {
        'score': grade.score,
        'output': '\n'.join(
            [*grade.notes, *(f'{name}: {text}' for name, text in remarks.items() if text)]
        ),
        'output_format': 'text',
        'visibility': grade.visibility,
        'stdout_visibility': 'hidden',
        'tests': tests,
        'extra_data': {'seed': grade.seed, 'sha256': grade.hashes},
    }
    return json.dumps(content, ensure_ascii=False, indent=2, allow_nan=False) + '\n'


def _cores() -> int:
    """Return the number of cores that this process may use, where the system limits that."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def processes(jobs: int | None) -> Iterator[Executor]:
    """Use `jobs` worker processes, by default one for each core that this process may use.

    When the block ends, those still at work end, and their folders go; they also end with this
    process, however it ends.
    """
    # New processes: a fork would copy the locks of other threads, but not the threads.
    context = multiprocessing.get_context('spawn')
    with tempfile.TemporaryDirectory(prefix='barc_sim_', ignore_cleanup_errors=True) as folder:
        pool = ProcessPoolExecutor(
            jobs or _cores(), context, initializer=_begin_worker, initargs=(folder,)
        )
        try:
            yield pool
        finally:
            # A second Ctrl-C would only delay the end.
            with suppress(KeyboardInterrupt), uninterrupted():
                pool.shutdown(wait=False, cancel_futures=True)
                workers = multiprocessing.active_children()
                for worker in workers:
                    worker.kill()
                for worker in workers:
                    worker.join()


def _begin_worker(folder: str) -> None:
    """Make temporary folders in `folder`, leave Ctrl-C to the parent process, and end with it."""
    tempfile.tempdir = folder
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent  # noqa: S101 (the pool's)
    # Its end closes a pipe, also where it is killed.
    threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    """End this process, and its folders, when the process of `sentinel` has ended."""
    connection.wait([sentinel])
    shutil.rmtree(tempfile.gettempdir(), ignore_errors=True)
    os._exit(1)


def run(
    executor: Executor,
    paths: Mapping[Path, ByHand],
    *how: Any,  # noqa: ANN401 (as `report` takes it)
    sandbox: bool,
) -> Iterator[tuple[Path, Grade | str]]:
    """Yield each submission with its grade, or the grader's error, in the order of completion."""
    work = partial(report, sandbox=sandbox)
    pending = {executor.submit(work, path, hand, *how): path for path, hand in paths.items()}
    for future in as_completed([*pending]):
        error = future.exception()
        kind = '' if isinstance(error, UserError) else f'{type(error).__name__}: '
        failure = f'{kind}{error}' if error else ''
        yield pending.pop(future), failure or future.result()
