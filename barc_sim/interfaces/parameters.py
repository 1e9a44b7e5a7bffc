"""What describes a parameter: its name, default, meaning, unit and limits.

There is one table of limits: a record declares its fields as `Annotated[float, description, low,
high]`, and `parameters_of` returns a `ParameterDeclaration` for each. Constructors, `simulate`,
nodes and options of commands check values against them, with the sentence of `not_between`.
"""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass
from math import inf
from typing import Annotated, Any, NamedTuple, TypeVar, get_origin, get_type_hints

from barc_sim.cli.limits import not_between
from barc_sim.errors import UserError

#: The bounds of a text or a flag: there are none.
UNBOUNDED = (-inf, inf)
_Record = TypeVar('_Record', bound=tuple[Any, ...])


class ParameterDeclaration(NamedTuple):
    """What describes a parameter of a node, or a field of a record."""

    name: str
    default: float | str | bool
    description: str  #: its meaning, with the unit in brackets
    #: Bounds of a number, ends included; they keep NaN out.
    between: tuple[float, float] = UNBOUNDED
    read_only: bool = False  #: whether it is fixed for a run

    @property
    def unit(self) -> str:
        """The unit, which stands in brackets in the description; empty without one."""
        match = re.search(r'\[([^]]+)\]', self.description)
        return match[1] if match else ''

    def check(self, value: object, name: str = '') -> None:
        """Raise UserError if `value`, given as the argument `name`, is not `between` the bounds."""
        if self.between == UNBOUNDED:
            return

        low, high = self.between
        reason = not_between(value, low, high)
        if reason:
            raise UserError(f'{name or self.name}: {reason}')


def parameters_of(record: type[Any]) -> list[ParameterDeclaration]:
    """Return a parameter for each field of a NamedTuple or dataclass that declares its meaning.

    A field is `Annotated[kind, description]`, `Annotated[kind, description, low, high]`, or
    `Annotated[kind, parameter]`, which shares meaning and limits of another parameter.
    """
    if is_dataclass(record):
        defaults = {field.name: field.default for field in fields(record)}
    else:
        defaults = record._field_defaults

    return [
        _parameter(name, defaults[name], *hint.__metadata__)
        for name, hint in get_type_hints(record, include_extras=True).items()
        if get_origin(hint) is Annotated
    ]


def _parameter(
    name: str,
    default: Any,  # noqa: ANN401 (of any kind)
    meaning: str | ParameterDeclaration,
    low: float = -inf,
    high: float = inf,
) -> ParameterDeclaration:
    if isinstance(meaning, ParameterDeclaration):
        return meaning._replace(name=name, default=default)
    return ParameterDeclaration(name, default, meaning, (low, high))


def limited(record: type[_Record]) -> type[_Record]:
    """Make the constructor of a record, a NamedTuple, refuse values beyond its fields' limits.

    `_make` and `_replace` check nothing: they are for values that have been checked.
    """
    rows = parameters_of(record)
    make: Any = record.__new__
    make.__annotations__ = get_type_hints(record)  # what `help` shows

    def new(cls: type[_Record], *values: Any, **keywords: Any) -> _Record:  # noqa: ANN401 (any field)
        instance: _Record = make(cls, *values, **keywords)
        for row in rows:
            row.check(getattr(instance, row.name))
        return instance

    new.__wrapped__ = make  # type: ignore[attr-defined]
    record.__new__ = new  # type: ignore[assignment]
    return record
