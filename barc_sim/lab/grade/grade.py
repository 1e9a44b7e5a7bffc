"""Grades a submission: reads the rubric and a person's points, and writes the report.

Rubrics and a person's points are YAML files. The file for a person's points is beside the report:
`grade` writes it once, without points, and then only reads it.

The states of a criterion, from its `Finding` to the class:

=======  ========================================  ==================  =====================
state    where it comes from                       points              in reports
=======  ========================================  ==================  =====================
judged   `score`, from 0 to 1                      those of the score  points and message
skipped  `skipped`: the file is missing; or it is  0; left out if it   a message; left out
         `relay.py`, and still the template's      is optional         if it is optional
open     `open`: a person judges it (`by_eye`),    0 until a person    "open"; not in the
         or a later Python is needed to read it    enters some         means of a class
by hand  `ByHand`: a person has entered points     those entered       also the earlier ones
=======  ========================================  ==================  =====================

Optional criteria are the extra ones below `task_3` in the rubric. That key is read for every lab,
though only the hills lab has a Task 3. `ClassEntry.looks` are the reasons for a person to look at a
submission, such as an open criterion; its `flags` are the values of the page's filter.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import tempfile
from dataclasses import dataclass, field, fields
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from barc_sim import __version__
from barc_sim.cli.text import one_line
from barc_sim.cli.yaml_files import read_yaml
from barc_sim.errors import UserError, escaped
from barc_sim.figures.files import save
from barc_sim.lab.files import BY_HAND, HANDOUTS, RUBRICS, candidates, missing, names_of, united
from barc_sim.lab.judge import Settings, Thresholds
from barc_sim.lab.labs import lab_of
from barc_sim.lab.pages import data_url, render

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from barc_sim.lab.confined.process import ProcessLimits
    from barc_sim.lab.judge import Evidence, Finding, Lab
    from barc_sim.lab.submission import Submission

    _Expected = tuple[Callable[[Any], bool], str]

_HEAD = """\
# Your file: barc grade reads it each time, and does not change it.
# Points that you enter replace the computed ones: 4.5, or 4.5 and a comment.
"""
_T = TypeVar('_T')
_LABS = tuple(map(lab_of, HANDOUTS.values()))
#: Every criterion, with its name for readers, in the order of a report.
LABELS = united(lab.labels for lab in _LABS)
VISIBILITIES = ('visible', 'hidden', 'after_due_date', 'after_published')
_MAX_COMMENT = 2000  # characters
_MAX_SHOWN = 80  # characters of a value in a sentence
_MAX_POINTS = 10_000  # for a criterion


@dataclass(frozen=True)
class Rubric:
    """The criteria of a grade, with their points."""

    points: Mapping[str, float]  #: by criterion, positive, in the order of `LABELS`
    settings: Settings = field(default_factory=Settings)  #: for judging user code
    title: str = ''
    visibility: str = VISIBILITIES[0]  #: who can read the messages on Gradescope
    optional: frozenset[str] = frozenset()  #: criteria that are left out if their file is missing

    @property
    def lab(self) -> Lab:
        """The lab that has its criteria."""
        return next(lab for lab in _LABS if not lab.labels.keys().isdisjoint(self.points))

    def worth(self, findings: Iterable[Finding]) -> dict[str, float]:
        """Return the maximum points by criterion, without optional criteria that are skipped."""
        out = {each.criterion for each in findings if each.skipped} & self.optional
        return {name: points for name, points in self.points.items() if name not in out}

    def points_for(self, finding: Finding) -> float:
        """Return the points for a finding, rounded to hundredths."""
        return round(self.points[finding.criterion] * min(max(finding.score, 0.0), 1.0), 2)


def load_rubric(rubric: str | Path = RUBRICS[0]) -> Rubric:
    """Return the rubric with a name in `RUBRICS`, or from the file at a path."""
    name = str(rubric)
    path = Path(name)
    if name in RUBRICS:
        path = Path(__file__).parent / 'rubrics' / f'{name}.yaml'
    return _read(f'the rubric {name!r}', path, _rubric)


def _read(what: str, path: Path, parse: Callable[[object], _T]) -> _T:
    """Read a YAML file, and return the result of `parse`; a UserError names the file as `what`."""
    try:
        return parse(read_yaml(path))
    except OSError as error:
        raise UserError(f'{what} cannot be read: {error.strerror or error}') from None
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f'{what}: {one_line(str(error), _MAX_COMMENT)}') from None


class ByHand(NamedTuple):
    """The points and comments that a person has entered for a submission."""

    points: Mapping[str, tuple[float, str]] = {}  #: points and a comment, by criterion
    comment: str = ''  #: on the whole submission


def entered(folder: Path, rubric: Rubric) -> ByHand:
    """Return the points and comments that are entered in the file in `folder`, if it exists."""
    path = folder / BY_HAND
    if not path.exists():
        return ByHand()
    return _read(repr(str(path)), path, partial(_by_hand, rubric))


def nothing_entered(rubric: Rubric) -> str:
    """Return the text of a file for a person's points, with none entered."""
    lines = [f'  {name}:  # of {worth:g}\n' for name, worth in rubric.points.items()]
    return f'{_HEAD}comment:\npoints:\n{"".join(lines)}'


def _by_hand(rubric: Rubric, values: object) -> ByHand:
    top = _mapping('it', values or {}, dict.fromkeys(('comment', 'points'), _ANY))
    points = _mapping('points', top.get('points') or {}, dict.fromkeys(rubric.points, _ANY))
    filled = {
        name: _entry(name, value, rubric.points[name])
        for name, value in points.items()
        if value is not None
    }
    return ByHand(filled, one_line(str(top.get('comment') or ''), _MAX_COMMENT))


def _entry(name: str, value: object, worth: float) -> tuple[float, str]:
    number, _, comment = str(value).partition(' ')
    try:
        points = float(number)
    except ValueError:
        points = -1.0
    if not 0.0 <= points <= worth:
        raise ValueError(
            f'{name} is {_shown(value)}: expected points from 0 to {worth:g}, and optionally a '
            'space and a comment'
        )
    return points, one_line(comment, _MAX_COMMENT)


def _rubric(values: object) -> Rubric:
    keys = {**_mapping('it', values, _KEYS)}
    if 'criteria' not in keys:
        raise ValueError('there is no key criteria: expected the points of each criterion')
    criteria = dict.fromkeys(LABELS, _POINTS)
    required = _mapping('criteria', keys.pop('criteria'), criteria)
    optional = _mapping('task_3', keys.pop('task_3', {}), criteria)
    for name in required.keys() & optional.keys():
        raise ValueError(f'{name!r} is in criteria and in task_3: delete one of the two')
    entries = required | optional
    points = {name: float(entries[name]) for name in LABELS if entries.get(name)}
    if not points:
        raise ValueError('no criterion has points: expected at least one')

    by_lab = {lab.handout.folder: name for lab in _LABS for name in points if name in lab.labels}
    if len(by_lab) > 1:
        names = list(by_lab.values())
        raise ValueError(
            f'{names[0]!r} and {names[1]!r} belong to two labs: keep the criteria of one'
        )

    thresholds = _thresholds(keys.pop('thresholds', {}))
    settings = Settings(keys.pop('seed', Settings.seed), thresholds, tuple(points), points)
    return Rubric(points, settings, optional=frozenset(optional.keys() & points.keys()), **keys)


def _thresholds(values: object) -> Thresholds:
    keys = {each.name: _POSITIVE for each in fields(Thresholds)}
    thresholds = Thresholds(**_mapping('thresholds', values, keys))
    for error in ('rms', 'max'):
        full = getattr(thresholds, f'full_{error}')
        zero = getattr(thresholds, f'zero_{error}')
        if not full < zero:
            raise ValueError(f'full_{error} is {full:g}: expected less than zero_{error}, {zero:g}')
    return thresholds


def _mapping(what: str, values: object, keys: Mapping[str, _Expected]) -> dict[str, Any]:
    """Return `values` if it is a mapping with only these keys and valid values."""
    if not isinstance(values, dict):
        raise ValueError(f'{what} is {_shown(values)}: expected lines "key: value"')  # noqa: TRY004
    for key, value in values.items():
        if key not in keys:
            raise ValueError(f'{_shown(key)} is unknown: expected one of {", ".join(keys)}')
        is_valid, expected = keys[key]
        if not is_valid(value):
            raise ValueError(f'{key} is {_shown(value)}: expected {expected}')
    return values


def _shown(value: object) -> str:
    """Return a value of a file as text for a sentence."""
    return one_line(repr(value), _MAX_SHOWN)


def _is_number(value: object) -> bool:
    return type(value) in {int, float}


# A check of a value, and the valid values in words.
_ANY: _Expected = (lambda _: True), ''
_POSITIVE: _Expected = (lambda value: _is_number(value) and 0.0 < value < inf), 'a number above 0'
_POINTS: _Expected = (
    (lambda value: _is_number(value) and 0.0 <= value <= _MAX_POINTS),
    f'points from 0 to {_MAX_POINTS}',
)
_KEYS: dict[str, _Expected] = {
    'title': ((lambda value: isinstance(value, str)), 'a text, in quotes'),
    'seed': ((lambda value: type(value) is int and value >= 0), 'a whole number from 0 on'),
    'visibility': (VISIBILITIES.__contains__, f'one of {", ".join(VISIBILITIES)}'),
    **dict.fromkeys(('thresholds', 'criteria', 'task_3'), _ANY),
}


_DPI = 100


class Item(NamedTuple):
    """The points for one criterion."""

    criterion: str
    points: float  #: rounded to hundredths
    max_points: float
    message: str
    open: bool = False  #: a person judges it: the points are 0 until they are entered by hand
    evidence: Evidence | None = None  #: of the report's figure

    @property
    def status(self) -> str:
        """Gradescope's word for the points."""
        return 'passed' if self.points >= self.max_points else 'failed'


class Grade(NamedTuple):
    """The points of a submission, with notes and printed output, and the files of its report."""

    name: str
    rubric: Rubric
    items: tuple[Item, ...]
    notes: tuple[str, ...] = ()
    printed: str = ''  #: the first output of its code
    hashes: Mapping[str, str] = {}  #: SHA-256, by file
    gains: str = ''  #: of the drives, and the line that chooses them
    tolerated: tuple[str, ...] = ()  #: faults that cost nothing, a phrase each
    comment: str = ''  #: of a person
    files: Mapping[str, bytes] = {}  #: by name

    @property
    def score(self) -> float:
        """The sum of the items' points."""
        return round(sum(item.points for item in self.items), 2)

    @property
    def max_score(self) -> float:
        """The sum of the items' maximum points."""
        return round(sum(item.max_points for item in self.items), 2)

    @property
    def points(self) -> dict[str, float]:
        """The points by criterion, without open criteria."""
        return {item.criterion: item.points for item in self.items if not item.open}

    @property
    def open(self) -> dict[str, float]:
        """The maximum points of the open criteria, which a person judges."""
        return {item.criterion: item.max_points for item in self.items if item.open}

    @property
    def mistakes(self) -> list[Item]:
        """The items that lost points, the largest loss first."""
        lost = [item for item in self.items if item.points < item.max_points and not item.open]
        return sorted(lost, key=lambda item: item.points - item.max_points)

    @property
    def remark(self) -> str:
        """The message of the criterion that lost most points."""
        return ''.join(f'{LABELS[item.criterion]}: {item.message}' for item in self.mistakes[:1])


def grade(submission: Submission, rubric: Rubric, limits: ProcessLimits) -> Grade:
    """Judge a submission; its code runs in a separate process and folder.

    A criterion's points are its maximum points times the finding's score, rounded to hundredths.
    """
    notes = submission.notes
    expected = rubric.lab.handout.files
    names = names_of(submission.files, expected)
    if not (names or notes):
        notes = (f'it has no {", ".join(expected.values())}',)
    for part in [each for each in expected if each not in names]:
        if candidates(submission.files, part):  # a person looks at it: optional parts have no line
            notes = (*notes, missing(rubric.lab.handout, part, submission.files))
    if not limits.confined:
        notes = (*notes, 'its code ran unconfined, because of --unconfined')

    with tempfile.TemporaryDirectory(prefix='barc_sim_grade_') as folder:
        submission.write(Path(folder))
        judged = rubric.lab.judge_folder(Path(folder), rubric.settings, limits)

    worth = rubric.worth(judged.findings)
    items = [
        Item(
            finding.criterion,
            rubric.points_for(finding),
            worth[finding.criterion],
            message=escaped(finding.message),
            open=finding.open,
            evidence=finding.evidence,
        )
        for finding in judged.findings
        if finding.criterion in worth
    ]
    return Grade(
        name=submission.name,
        rubric=rubric,
        items=tuple(items),
        notes=notes,
        printed=escaped(judged.printed),
        hashes={
            name: hashlib.sha256(submission.files[name]).hexdigest() for name in names.values()
        },
        gains=escaped(str(judged.gains or '')),
        tolerated=tuple(map(escaped, judged.tolerated)),
    )


def report(submission: Submission, hand: ByHand, rubric: Rubric, limits: ProcessLimits) -> Grade:
    """Grade a submission, with points entered by hand, and make the files of its report."""
    merged = _merged(grade(submission, rubric, limits), hand)
    files = {
        'results.json': gradescope(merged).encode(),
        'report.html': report_page(merged).encode(),
    }
    # The figure is drawn. A drive is large, and the grade goes to another process.
    items = tuple(item._replace(evidence=None) for item in merged.items)
    return merged._replace(items=items, files=files)


def _merged(grade: Grade, hand: ByHand) -> Grade:
    """Return the grade with entered points in place of computed ones."""
    items = {item.criterion: item for item in grade.items}
    for name, (points, comment) in hand.points.items():
        computed = items.get(name) or Item(name, 0.0, grade.rubric.points[name], '', open=True)
        was = 'open' if computed.open else f'{computed.points:g}'
        texts = (comment, f'by hand (computed: {was})', computed.message)
        message = '; '.join(filter(None, texts))
        items[name] = computed._replace(points=points, message=message, open=False)
    order = tuple(items[name] for name in grade.rubric.points if name in items)
    return grade._replace(items=order, comment=hand.comment)


def report_page(grade: Grade) -> str:
    """Return the HTML report, with a figure of the judged drive."""
    png = io.BytesIO()
    for item in grade.items:
        if item.evidence:
            save(item.evidence.figure(''), png, format='png', dpi=_DPI, metadata={'Software': ''})

    score = f'{grade.score:g} / {grade.max_score:g}'
    if grade.open:
        score += f', {sum(grade.open.values()):g} open'

    return render(
        'grade',
        grade=grade,
        score=score,
        labels=LABELS,
        versions=versions(),
        figures=data_url('image/png', png.getvalue()) if png.tell() else '',
    )


def versions() -> dict[str, str]:
    """Return the versions that a score can depend on, by name."""
    return {
        'Python': platform.python_version(),
        'NumPy': np.__version__,
        'barc_sim': __version__,
    }


def gradescope(grade: Grade) -> str:
    """Return the text of Gradescope's `results.json`.

    https://gradescope-autograders.readthedocs.io/en/latest/specs/
    """
    tests = []
    for item in grade.items:
        test = {
            'name': LABELS[item.criterion],
            'number': item.criterion,
            'max_score': item.max_points,
            'output': item.message,
            'output_format': 'text',
            'visibility': grade.rubric.visibility,
        }
        if not item.open:  # an open criterion has no score yet
            test |= {'score': item.points, 'status': item.status}
        tests.append(test)

    remarks = {
        'comment': grade.comment,
        'gains': grade.gains,
        'tolerated': '; '.join(grade.tolerated),
    }
    lines = [*grade.notes, *(f'{name}: {text}' for name, text in remarks.items() if text)]

    content = {
        'score': grade.score,
        'output': '\n'.join(lines),
        'output_format': 'text',
        'visibility': grade.rubric.visibility,
        'stdout_visibility': 'hidden',
        'tests': tests,
        'extra_data': {
            'seed': grade.rubric.settings.seed,
            'sha256': grade.hashes,
            'versions': versions(),
        },
    }
    return json.dumps(content, ensure_ascii=False, indent=2, allow_nan=False) + '\n'
