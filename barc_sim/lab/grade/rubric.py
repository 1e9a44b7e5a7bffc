"""Points that a person writes, in YAML files: the rubric, and those for one submission.

The second kind is a file beside a report. `grade` writes it once, with the computed points as
comments, and then only reads it. It is written again only while nothing is entered in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import yaml

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError, one_line
from barc_sim.lab.files import BY_HAND, RUBRICS
from barc_sim.lab.judge import Settings, Thresholds
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.identify import IDENTIFY
from barc_sim.lab.labs.lane import LANE
from barc_sim.lab.labs.raceline import RACELINE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    _Read = Callable[[str, object], Any]

    from barc_sim.lab.judge import Finding, Lab

_T = TypeVar('_T')
_LABS = (HILLS, LANE, RACELINE, IDENTIFY)
#: Every criterion, with its name for readers, in the order of a report.
LABELS = {name: label for lab in _LABS for name, label in lab.labels.items()}
VISIBILITIES = ('visible', 'hidden', 'after_due_date', 'after_published')
_MAX_BYTES, _MAX_COMMENT = 1 << 20, 2000
_MAX_POINTS = 10_000  # for a criterion


@dataclass(frozen=True)
class Rubric:
    """The criteria of a grade, with their points."""

    points: Mapping[str, float]  #: by criterion, positive, in the order of `LABELS`
    settings: Settings = field(default_factory=Settings)  #: how it has user code judged
    title: str = ''
    visibility: str = VISIBILITIES[0]  #: who can read the messages on Gradescope
    optional: frozenset[str] = frozenset()  #: criteria left out where their file is not handed in

    @property
    def lab(self) -> Lab:
        """The lab of its criteria."""
        return next(lab for lab in _LABS if not lab.labels.keys().isdisjoint(self.points))

    @property
    def max_score(self) -> float:
        """Return the sum of the points without those of optional criteria."""
        return round(sum(v for name, v in self.points.items() if name not in self.optional), 2)

    def worth(self, findings: Iterable[Finding]) -> dict[str, float]:
        """Return the maximum points by criterion, without the optional ones that are skipped."""
        out = {each.criterion for each in findings if each.skipped} & self.optional
        return {name: points for name, points in self.points.items() if name not in out}

    def points_for(self, finding: Finding) -> float:
        """Return the points for a finding, rounded to hundredths."""
        return round(self.points[finding.criterion] * min(max(finding.score, 0.0), 1.0), 2)


def load(rubric: str | Path = RUBRICS[0]) -> Rubric:
    """Return the rubric of that name in `RUBRICS`, or in the file at that path, or a UserError."""
    name = str(rubric)
    shipped = Path(__file__).parent / 'rubrics' / f'{name}.yaml'
    return _read(f'the rubric {name!r}', shipped if name in RUBRICS else Path(name), _rubric)


def _read(what: str, path: Path, parse: Callable[[object], _T]) -> _T:
    """Return what `parse` makes of a YAML file; a UserError names `what` it is."""
    try:
        return parse(yaml.safe_load(read_regular(path, _MAX_BYTES)))
    except OSError as error:
        raise UserError(f'{what} cannot be read: {error.strerror or error}') from None
    except yaml.YAMLError as error:
        raise UserError(f'{what} is not YAML: {one_line(str(error), 200)}') from None
    except ValueError as error:
        raise UserError(f'{what}: {error}') from None


class ByHand(NamedTuple):
    """What a person has entered for a submission."""

    points: Mapping[str, tuple[float, str]] = {}  #: and a comment on them, by criterion
    comment: str = ''  #: on all of it

    def __bool__(self) -> bool:
        """Return whether anything is entered."""
        return bool(self.points or self.comment)


def entered(folder: Path, rubric: Rubric) -> ByHand:
    """Return what is entered in the file in `folder`; nothing without one; or a UserError."""
    path = folder / BY_HAND
    return _read(repr(str(path)), path, partial(_by_hand, rubric)) if path.exists() else ByHand()


def _by_hand(rubric: Rubric, values: object) -> ByHand:
    found = _mapping('it', values or {}, {'comment': _any, 'points': _any})
    criteria = dict.fromkeys(rubric.points, _entry)
    points = _mapping('points', found.get('points') or {}, criteria)
    given = {name: entry for name, entry in points.items() if entry}
    return ByHand(given, one_line(str(found.get('comment') or ''), _MAX_COMMENT))


def _entry(name: str, value: object) -> tuple[float, str] | None:
    if value is None:
        return None
    number, _, comment = str(value).partition(' ')
    try:
        points = float(number)
    except ValueError:
        points = -1.0
    if not 0.0 <= points < inf:
        raise ValueError(
            f'{name} is {value!r}: expected points such as 4.5, and after a space a comment if you '
            'like'
        )
    return points, one_line(comment, _MAX_COMMENT)


def _rubric(values: object) -> Rubric:
    found = _mapping('it', values, _KEYS)
    if 'criteria' not in found:
        raise ValueError('there is no key criteria: expected the points of each criterion')
    required, optional = found.pop('criteria'), found.pop('task_3', {})
    for name in required.keys() & optional.keys():
        raise ValueError(f'{name!r} stands in criteria and in task_3: delete one of the two')
    points = {name: worth for name in LABELS if (worth := (required | optional).get(name))}
    of_labs = {lab.handout.folder: name for lab in _LABS for name in points if name in lab.labels}
    if len(of_labs) > 1:
        first, second, *_ = of_labs.values()
        raise ValueError(f'{first!r} and {second!r} are of two labs: keep the criteria of one')
    names = [each.name for each in fields(Settings) if each.name in found]
    settings = Settings(criteria=tuple(points), **{name: found.pop(name) for name in names})
    return Rubric(points, settings, optional=frozenset(optional), **found)


def _mapping(what: str, values: object, read: Mapping[str, _Read]) -> dict[str, Any]:
    """Return the values of a mapping, each read as its key's; refuse other keys."""
    if not isinstance(values, dict):
        raise ValueError(f'{what} is {values!r}: expected lines "key: value"')  # noqa: TRY004
    for key in values:
        if key not in read:
            raise ValueError(f'{key!r} is unknown: expected one of {", ".join(read)}')
    return {key: read[key](key, value) for key, value in values.items()}


def _thresholds(key: str, values: object) -> Thresholds:
    names = [each.name for each in fields(Thresholds)]
    thresholds = Thresholds(**_mapping(key, values, dict.fromkeys(names, _positive)))
    for error in ('rms', 'max'):
        full, zero = (getattr(thresholds, f'{end}_{error}') for end in ('full', 'zero'))
        if not full < zero:
            raise ValueError(f'full_{error} is {full:g}: expected less than zero_{error}, {zero:g}')
    return thresholds


def _criteria(key: str, values: object) -> dict[str, float]:
    points = _mapping(key, values, dict.fromkeys(LABELS, _points))
    if not any(points.values()):
        raise ValueError('no criterion has points: expected at least one')
    return {name: float(worth) for name, worth in points.items() if worth}


def _scalar(fits: Callable[[Any], bool], expected: str, sentence: str = '{} is {!r}') -> _Read:
    """Return what reads a value that `fits`."""

    def read(key: str, value: object) -> Any:  # noqa: ANN401 (any that fits)
        if not fits(value):
            raise ValueError(f'{sentence.format(key, value)}: expected {expected}')
        return value

    return read


_any = _scalar(lambda _: True, '')


def _is_number(value: object) -> bool:
    return type(value) in {int, float}


_positive = _scalar(lambda value: _is_number(value) and 0.0 < value < inf, 'a number above 0')
_points = _scalar(
    lambda value: _is_number(value) and 0.0 <= value <= _MAX_POINTS,
    f'points from 0 to {_MAX_POINTS}',
    '{} is worth {!r}',
)
#: What reads the value of each key.
_KEYS: dict[str, _Read] = {
    'title': _scalar(lambda value: isinstance(value, str), 'a text, in quotes'),
    'seed': _scalar(lambda value: type(value) is int and value >= 0, 'a whole number from 0 on'),
    'visibility': _scalar(VISIBILITIES.__contains__, f'one of {", ".join(VISIBILITIES)}'),
    'thresholds': _thresholds,
    'criteria': _criteria,
    'task_3': _criteria,
}
