"""The files of one graded submission: the HTML report, and Gradescope's results."""

from __future__ import annotations

import io
import json
import threading
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.lab.check.figure import check_figure
from barc_sim.lab.check.findings import LABELS, Comparison, Trajectory
from barc_sim.lab.grade.grade import grade
from barc_sim.lab.grade.similarity import passages
from barc_sim.lab.html import data_url, render

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.lab.confined.process import Limits
    from barc_sim.lab.grade.grade import Grade
    from barc_sim.lab.grade.rubric import Rubric
    from barc_sim.lab.grade.submissions import Submission


_DPI = 100
# Matplotlib's settings are global, and several threads can draw.
_DRAWING = threading.Lock()


class Report(NamedTuple):
    """The numbers of a grade, and the contents of its files by name."""

    name: str
    score: float
    max_score: float
    points: dict[str, float]  #: by criterion
    remark: str  #: notes, and the message of the criterion that lost most points
    files: dict[str, bytes]
    notes: tuple[str, ...] = ()  #: on files that were left out
    mistakes: Mapping[str, str] = {}  #: message of each criterion that lost points
    passages: frozenset[int] = frozenset()  #: of its code, see `similarity`


def report(submission: Submission, rubric: Rubric, limits: Limits, *, sandbox: bool) -> Report:
    """Judge a submission and return its files, in memory."""
    result = grade(submission, rubric, limits, sandbox=sandbox)
    worst = max(result.items, key=lambda item: item.max_points - item.points)
    mistakes = {
        item.criterion: item.message for item in result.items if item.points < item.max_points
    }
    return Report(
        name=result.name,
        score=result.score,
        max_score=result.max_score,
        points={item.criterion: item.points for item in result.items},
        remark='; '.join(
            (
                *result.notes,
                *([f'{LABELS[worst.criterion]}: {worst.message}'] if mistakes else ()),
            )
        ),
        files={
            'results.json': gradescope(result).encode(),
            'report.html': page(result, _figure(result)).encode(),
        },
        notes=result.notes,
        mistakes=mistakes,
        passages=passages(submission.files),
    )


def _figure(grade: Grade) -> bytes:
    """Return the runs that were judged as a PNG; empty if there are none."""
    evidence = [item.evidence for item in grade.items]
    runs = next((each for each in evidence if isinstance(each, Comparison)), None)
    states = next((each for each in evidence if isinstance(each, Trajectory)), None)
    if runs is None and states is None:
        return b''
    data = io.BytesIO()
    with _DRAWING:
        check_figure(runs, states).savefig(data, format='png', dpi=_DPI, metadata={'Software': ''})
    return data.getvalue()


def page(grade: Grade, figures: bytes) -> str:
    """Return the HTML report; `figures` is a PNG, or empty."""
    return render(
        'grade',
        grade=grade,
        score=f'{grade.score:g} / {grade.max_score:g}',
        labels=LABELS,
        figures=data_url('image/png', figures) if figures else '',
    )


def gradescope(grade: Grade) -> str:
    """Return the text of Gradescope's `results.json`.

    https://gradescope-autograders.readthedocs.io/en/latest/specs/
    """
    tests = [
        {
            'name': LABELS[item.criterion],
            'number': item.criterion,
            'score': item.points,
            'max_score': item.max_points,
            'status': 'passed' if item.points == item.max_points else 'failed',
            'output': item.message,
            'output_format': 'text',
            'visibility': grade.visibility,
        }
        for item in grade.items
    ]
    remarks = {'gains': grade.gains, 'tolerated': '; '.join(grade.tolerated)}
    content = {
        'score': grade.score,
        'output': '\n'.join(
            [*grade.notes, *(f'{name}: {text}' for name, text in remarks.items() if text)]
        ),
        'output_format': 'text',
        'visibility': grade.visibility,
        'stdout_visibility': 'hidden',
        'tests': tests,
        'extra_data': {'seed': grade.seed, 'sha256': dict(grade.hashes)},
    }
    return json.dumps(content, ensure_ascii=False, indent=2, allow_nan=False) + '\n'
