"""The rubric: the points of each criterion, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import yaml

from barc_sim.errors import UserError
from barc_sim.lab.check.findings import CRITERIA
from barc_sim.lab.check.judging import Settings
from barc_sim.lab.check.loop import Thresholds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from barc_sim.lab.check.findings import Finding

#: The names of the rubrics in `rubrics/`.
SHIPPED = ('lab', 'strict', 'extended')
DEFAULT = 'lab'
VISIBILITIES = ('visible', 'hidden', 'after_due_date', 'after_published')
_MOST = 10_000  # points for a criterion


@dataclass(frozen=True)
class Rubric:
    """The criteria of a grade, with their points."""

    title: str
    seed: int  #: of the states and roads
    visibility: str  #: one of `VISIBILITIES`: who can read the messages on Gradescope
    points: Mapping[str, float]  #: by criterion, positive, in `CRITERIA`'s order
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


def load(rubric: str | Path = DEFAULT) -> Rubric:
    """Return the rubric of that name in `SHIPPED`, or in the file at that path.

    Raises
    ------
    UserError
        if the file cannot be read or has an error; it names the line.

    Examples
    --------
    >>> rubric = load('lab')
    >>> sum(rubric.points.values())
    120.0
    """
    name = str(rubric)
    try:
        text = path_of(rubric).read_text(encoding='utf-8')
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
    """Return the file of a rubric.

    Examples
    --------
    >>> path_of('strict').name
    'strict.yaml'
    """
    shipped = str(rubric) in SHIPPED
    return Path(__file__).parent / 'rubrics' / f'{rubric}.yaml' if shipped else Path(rubric)


class _Reader:
    """Reads the nodes of YAML, which have line numbers."""

    def __init__(self, name: str) -> None:
        self._name = name

    def rubric(self, root: yaml.Node | None) -> Rubric:
        read: dict[str, Callable[[str, yaml.Node], Any]] = {
            'title': self._title,
            'seed': self._seed,
            'visibility': self._visibility,
            'thresholds': self._thresholds,
            'acceleration_limit': self._limit,
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
        required, optional = found['criteria'], found.get('task_3', {})
        for name in required.keys() & optional.keys():
            self._refuse(root, f'{name!r} stands in criteria and in task_3: delete one of the two')
        points = required | optional
        return Rubric(
            title=found.get('title', ''),
            seed=found.get('seed', 0),
            visibility=found.get('visibility', VISIBILITIES[0]),
            points={name: points[name] for name in CRITERIA if name in points},
            optional=frozenset(optional),
            thresholds=found.get('thresholds', Thresholds()),
            acceleration_limit=found.get('acceleration_limit', inf),
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

    def _title(self, key: str, node: yaml.Node) -> str:
        value = self._value(node)
        if not isinstance(value, str):
            self._refuse(node, f'{key} is {value!r}: expected a text, in quotes')
        return value

    def _seed(self, key: str, node: yaml.Node) -> int:
        value = self._value(node)
        if type(value) is not int or value < 0:
            self._refuse(node, f'{key} is {value!r}: expected a whole number from 0 on')
        return value

    def _visibility(self, key: str, node: yaml.Node) -> str:
        value = self._value(node)
        if value not in VISIBILITIES:
            self._refuse(node, f'{key} is {value!r}: expected one of {", ".join(VISIBILITIES)}')
        return str(value)

    def _thresholds(self, key: str, node: yaml.Node) -> Thresholds:
        names = tuple(each.name for each in fields(Thresholds))
        values = {
            name: self._positive(name, value) for name, value in self._items(key, node, names)
        }
        thresholds = Thresholds(**values)
        for error in ('rms', 'max'):
            full, zero = (getattr(thresholds, f'{end}_{error}') for end in ('full', 'zero'))
            if not full < zero:
                self._refuse(
                    node, f'full_{error} is {full:g}: expected less than zero_{error}, {zero:g}'
                )
        return thresholds

    def _limit(self, key: str, node: yaml.Node) -> float:
        return self._positive(key, node)

    def _positive(self, key: str, node: yaml.Node) -> float:
        value = self._value(node)
        if type(value) not in {int, float} or not 0.0 < value < inf:
            self._refuse(node, f'{key} is {value!r}: expected a number above 0')
        return float(value)

    def _criteria(self, key: str, node: yaml.Node) -> dict[str, float]:
        points = {
            name: self._points(name, value) for name, value in self._items(key, node, CRITERIA)
        }
        points = {name: points[name] for name in CRITERIA if points.get(name)}
        if not points:
            self._refuse(node, 'no criterion has points: expected at least one')
        return points

    def _points(self, key: str, node: yaml.Node) -> float:
        value = self._value(node)
        if type(value) not in {int, float} or not isfinite(value) or not 0 <= value <= _MOST:
            self._refuse(node, f'{key} is worth {value!r}: expected points from 0 to {_MOST}')
        return float(value)

    def _value(self, node: yaml.Node) -> Any:  # noqa: ANN401 (any YAML value)
        if not isinstance(node, yaml.ScalarNode):
            return 'a list' if isinstance(node, yaml.SequenceNode) else 'a mapping'
        try:
            return yaml.SafeLoader('').construct_object(node)
        except (yaml.YAMLError, ValueError):
            return node.value

    def _refuse(self, node: yaml.Node, message: str) -> NoReturn:
        raise UserError(f'the rubric {self._name!r}, line {node.start_mark.line + 1}: {message}')
