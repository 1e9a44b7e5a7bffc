"""The rubric: the points of each criterion, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from math import isfinite
from typing import TYPE_CHECKING, Any, NoReturn

import yaml

from barc_sim.errors import UserError
from barc_sim.lab.check.findings import CRITERIA

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

VISIBILITIES = ('visible', 'hidden', 'after_due_date', 'after_published')
_MOST = 10_000  # points for a criterion


@dataclass(frozen=True)
class Rubric:
    """The criteria of a grade, with their points."""

    title: str
    seed: int  #: of the states and roads
    visibility: str  #: one of `VISIBILITIES`: who can read the messages on Gradescope
    points: Mapping[str, float]  #: by criterion, positive, in `CRITERIA`'s order

    @property
    def max_score(self) -> float:
        """Return the sum of all points."""
        return round(sum(self.points.values()), 2)


def load(path: Path | None = None) -> Rubric:
    """Return the rubric in the file at `path`, or the default one.

    Raises
    ------
    UserError
        if the file cannot be read or has an error; it names the line.
    """
    name = str(path or 'the default rubric')
    try:
        text = (path or files('barc_sim.lab.grade') / 'rubric.yaml').read_text(encoding='utf-8')
    except OSError as error:
        raise UserError(f'the rubric {name!r} cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise UserError(f'the rubric {name!r} cannot be read: {error}') from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise UserError(f'the rubric {name!r} is not YAML: {error}') from None
    return _Reader(name).rubric(root)


class _Reader:
    """Reads the nodes of YAML, which have line numbers."""

    def __init__(self, name: str) -> None:
        self._name = name

    def rubric(self, root: yaml.Node | None) -> Rubric:
        read: dict[str, Callable[[str, yaml.Node], Any]] = {
            'title': self._title,
            'seed': self._seed,
            'visibility': self._visibility,
            'criteria': self._criteria,
        }
        if root is None:
            raise UserError(f'the rubric {self._name!r} is empty: expected {", ".join(read)}')
        found = {
            key: read[key](key, value) for key, value in self._items('the rubric', root, (*read,))
        }
        if 'criteria' not in found:
            self._refuse(root, 'there is no key criteria: expected the points of each criterion')
        return Rubric(
            title=found.get('title', ''),
            seed=found.get('seed', 0),
            visibility=found.get('visibility', VISIBILITIES[0]),
            points=found['criteria'],
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
