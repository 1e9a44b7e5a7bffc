"""The rubric: the points of each criterion, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import yaml

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError
from barc_sim.lab.handout import RUBRICS
from barc_sim.lab.hills.lab import CRITERIA, Settings
from barc_sim.lab.hills.loop import Thresholds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from barc_sim.lab.check.findings import Finding

VISIBILITIES = ('visible', 'hidden', 'after_due_date', 'after_published')
_MAX_BYTES = 1 << 20  #: of a rubric
_MOST = 10_000  # points for a criterion


@dataclass(frozen=True)
class Rubric:
    """The criteria of a grade, with their points."""

    points: Mapping[str, float]  #: by criterion, positive, in `CRITERIA`'s order
    title: str = ''
    seed: int = 0  #: of the states and roads
    visibility: str = VISIBILITIES[0]  #: who can read the messages on Gradescope
    optional: frozenset[str] = frozenset()  #: criteria left out where their file is not handed in
    thresholds: Thresholds = field(default_factory=Thresholds)  #: of the criteria `loop.…`
    acceleration_limit: float = inf  #: [m/s²] of a controller on the roads

    @property
    def max_score(self) -> float:
        """Return the sum of the points without those of optional criteria."""
        return round(sum(v for name, v in self.points.items() if name not in self.optional), 2)

    def worth(self, findings: Iterable[Finding]) -> dict[str, float]:
        """Return the greatest points by criterion, without the optional ones that are skipped."""
        out = {each.criterion for each in findings if each.skipped} & self.optional
        return {name: points for name, points in self.points.items() if name not in out}

    @property
    def settings(self) -> Settings:
        """How it has user code judged."""
        return Settings(
            seed=self.seed,
            acceleration_limit=self.acceleration_limit,
            thresholds=self.thresholds,
            criteria=tuple(self.points),
        )

    def points_for(self, finding: Finding) -> float:
        """Return the points for a finding, rounded to hundredths."""
        return round(self.points[finding.criterion] * min(max(finding.score, 0.0), 1.0), 2)


def load(rubric: str | Path = RUBRICS[0]) -> Rubric:
    """Return the rubric of that name in `RUBRICS`, or in the file at that path.

    Raises
    ------
    UserError
        if the file cannot be read or has an error; it names the line.
    """
    name = str(rubric)
    try:
        text = read_regular(path_of(rubric), _MAX_BYTES).decode()
    except OSError as error:
        raise UserError(f'the rubric {name!r} cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise UserError(f'the rubric {name!r} cannot be read: {error}') from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise UserError(f'the rubric {name!r} is not YAML: {error}') from None
    return _Reader(name).rubric(root)


def path_of(rubric: str | Path) -> Path:
    """Return the file of a rubric."""
    shipped = str(rubric) in RUBRICS
    return Path(__file__).parent / 'rubrics' / f'{rubric}.yaml' if shipped else Path(rubric)


class _Wanted(NamedTuple):
    """What a value of the file must be."""

    fits: Callable[[Any], bool]
    expected: str
    sentence: str = '{} is {!r}'


def _is_number(value: object) -> bool:
    return type(value) in {int, float}


_TEXT = _Wanted(lambda value: isinstance(value, str), 'a text, in quotes')
_SEED = _Wanted(lambda value: type(value) is int and value >= 0, 'a whole number from 0 on')
_VISIBILITY = _Wanted(VISIBILITIES.__contains__, f'one of {", ".join(VISIBILITIES)}')
_POSITIVE = _Wanted(lambda value: _is_number(value) and 0.0 < value < inf, 'a number above 0')
_POINTS = _Wanted(
    lambda value: _is_number(value) and 0.0 <= value <= _MOST,
    f'points from 0 to {_MOST}',
    '{} is worth {!r}',
)


class _Reader:
    """Reads the nodes of YAML, which have line numbers."""

    def __init__(self, name: str) -> None:
        self._name = name

    def rubric(self, root: yaml.Node | None) -> Rubric:
        read: dict[str, Callable[[str, yaml.Node], Any]] = {
            'title': partial(self._value, _TEXT),
            'seed': partial(self._value, _SEED),
            'visibility': partial(self._value, _VISIBILITY),
            'thresholds': self._thresholds,
            'acceleration_limit': partial(self._value, _POSITIVE),
            'criteria': self._criteria,
            'task_3': self._criteria,
        }
        if root is None:
            raise UserError(f'the rubric {self._name!r} is empty: expected {", ".join(read)}')
        found = {
            key: read[key](key, value) for key, value in self._items('the rubric', root, (*read,))
        }
        if 'criteria' not in found:
            self._refuse(root, 'there is no key criteria: expected the points of each criterion')
        required, optional = found.pop('criteria'), found.pop('task_3', {})
        for name in required.keys() & optional.keys():
            self._refuse(root, f'{name!r} stands in criteria and in task_3: delete one of the two')
        points = required | optional
        return Rubric(
            points={name: points[name] for name in CRITERIA if name in points},
            optional=frozenset(optional),
            **found,
        )

    def _items(
        self, what: str, node: yaml.Node, known: tuple[str, ...]
    ) -> Iterator[tuple[str, yaml.Node]]:
        """Yield the keys and values of a mapping; refuse unknown and repeated keys."""
        if not isinstance(node, yaml.MappingNode):
            self._refuse(node, f'{what} is not a mapping: expected lines of the form "key: value"')
        seen = set()
        for key_node, value in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else ''
            if key not in known:
                self._refuse(key_node, f'{key!r} is unknown: expected one of {", ".join(known)}')
            if key in seen:
                self._refuse(key_node, f'{key!r} is there twice: delete one of the two')
            seen.add(key)
            yield key, value

    def _thresholds(self, key: str, node: yaml.Node) -> Thresholds:
        names = tuple(each.name for each in fields(Thresholds))
        thresholds = Thresholds(
            **{name: self._value(_POSITIVE, name, n) for name, n in self._items(key, node, names)}
        )
        for error in ('rms', 'max'):
            full, zero = (getattr(thresholds, f'{end}_{error}') for end in ('full', 'zero'))
            if not full < zero:
                self._refuse(
                    node, f'full_{error} is {full:g}: expected less than zero_{error}, {zero:g}'
                )
        return thresholds

    def _criteria(self, key: str, node: yaml.Node) -> dict[str, float]:
        items = self._items(key, node, CRITERIA)
        points = {name: float(self._value(_POINTS, name, value)) for name, value in items}
        if not any(points.values()):
            self._refuse(node, 'no criterion has points: expected at least one')
        return {name: worth for name, worth in points.items() if worth}

    def _value(self, wanted: _Wanted, key: str, node: yaml.Node) -> Any:  # noqa: ANN401 (as wanted)
        value: Any = 'a list' if isinstance(node, yaml.SequenceNode) else 'a mapping'
        scalar = isinstance(node, yaml.ScalarNode)
        if scalar:
            try:
                value = yaml.SafeLoader('').construct_object(node)
            except (yaml.YAMLError, ValueError):
                value = node.value
        if not (scalar and wanted.fits(value)):
            self._refuse(node, f'{wanted.sentence.format(key, value)}: expected {wanted.expected}')
        return value

    def _refuse(self, node: yaml.Node, message: str) -> NoReturn:
        raise UserError(f'the rubric {self._name!r}, line {node.start_mark.line + 1}: {message}')
