"""Loads YAML that anyone may have written: rubrics, points by hand, parameters, parts of a bag.

The text is short, not deep, and has few aliases. It has no numbers that Python cannot print, and no
characters that no file can hold. PyYAML alone bounds none of these.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.cli.files import decoded, read_regular

if TYPE_CHECKING:
    from pathlib import Path

MAX_YAML = 200_000  #: characters
_MAX_DEPTH = 50  # of lists and mappings within one another
_MAX_VALUES = 200_000  # lists, mappings and scalars; those of an alias count each time
_MAX_NUMBER = 400  # characters of a number


class _Loader(yaml.SafeLoader):
    """Loads values as ROS reads them, within the bounds of this module."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._values = 0
        #: By the number of its node: the values in a list or mapping, or of a scalar.
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node, and charge its values."""
        if self.check_event(yaml.AliasEvent):
            node = super().compose_node(parent, index)
            if id(node) not in self._sizes:
                raise ValueError('an alias refers to a list or mapping that it is in')
            self._charge(self._sizes[id(node)])
            return node

        before = self._values
        self._charge(1)
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ValueError(f'more than {_MAX_DEPTH} lists or mappings are within one another')

        node = super().compose_node(parent, index)
        self._depth -= 1
        self._sizes[id(node)] = self._values - before
        return node

    def _charge(self, values: int) -> None:
        self._values += values
        if self._values > _MAX_VALUES:
            raise ValueError(f'it has more than {_MAX_VALUES} values, where aliases count in full')

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:  # noqa: ANN401 (as its base)
        """Return the tag of a node; ValueError: it is a long number.

        The patterns of numbers take long for a long text, which is no number.
        """
        if kind is yaml.ScalarNode and implicit[0] and len(value) > _MAX_NUMBER:
            if _LIKE_A_NUMBER.fullmatch(value):
                raise ValueError(f'a number has {len(value)} characters')
            return 'tag:yaml.org,2002:str'
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]

    def construct_scalar(self, node: Any) -> Any:  # noqa: ANN401 (as its base class has it)
        """Return the text of a scalar; ValueError: it is a long number, or no valid text."""
        text: Any = super().construct_scalar(node)
        if node.tag in _NUMBERS and len(text) > _MAX_NUMBER:
            raise ValueError(f'a number has {len(text)} characters')
        if isinstance(text, str):
            text.encode()  # a UnicodeEncodeError is a ValueError
        return text


_LIKE_A_NUMBER = re.compile(r'[-+]?[\d.][\w.:+-]*')
_NUMBERS = {'tag:yaml.org,2002:int', 'tag:yaml.org,2002:float'}
# ROS reads 1e3, inf and nan as numbers, too.
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?((\d+\.?\d*|\.\d+)[eE][-+]?\d+|inf|nan)$'),
    list('-+.0123456789in'),
)


def from_yaml(text: str) -> Any:  # noqa: ANN401 (any YAML)
    """Return the value of YAML.

    Raises
    ------
    ValueError
        It is invalid, too long or deep, or has many aliases.

    Examples
    --------
    >>> from_yaml('gains: {kp: 1e3, ki: 0.5}')
    {'gains': {'kp': 1000.0, 'ki': 0.5}}
    """
    if len(text) > MAX_YAML:
        raise ValueError(f'it has {len(text)} characters, where {MAX_YAML} are the maximum')
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 (a SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f' in line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        raise ValueError(f'it is not YAML: {error.problem}{place}') from None
    except (yaml.YAMLError, AttributeError, TypeError, LookupError) as error:
        raise ValueError(f'it is not YAML: {error}') from None


def read_yaml(path: Path) -> Any:  # noqa: ANN401 (any YAML)
    """Return the value of a YAML file.

    Raises
    ------
    UserError
        It is no regular file, or too large.
    ValueError
        It cannot be loaded.
    OSError
        It cannot be read.
    """
    return from_yaml(decoded(read_regular(path, 4 * MAX_YAML)))
