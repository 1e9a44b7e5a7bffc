"""The one table of limits: what a number of the simulation may be, at its declaration.

A record declares its fields as `Annotated[float, description, low, high]`, and a node its
parameters with `Parameter`. Constructors, `simulate`, nodes and options of commands check values
against them, with the sentence of `not_between`.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple, TypeVar, get_type_hints

from barc_sim.errors import UserError, not_between
from barc_sim.vehicle.bike_model import Vehicle

#: Of a text or a flag.
ANY = (-inf, inf)
_Record = TypeVar('_Record', bound=tuple[Any, ...])


class Parameter(NamedTuple):
    """A parameter of a node; `between` bounds a number, ends included, and so keeps NaN out."""

    name: str
    default: float | str | bool
    description: str
    between: tuple[float, float] = ANY
    read_only: bool = False

    def check(self, value: object, name: str = '') -> None:
        """Raise UserError where `value`, given as the argument `name`, is not `between`."""
        if self.between != ANY and (why := not_between(value, *self.between)):
            raise UserError(f'{name or self.name}: {why}')


def parameters_of(record: type[tuple[Any, ...]]) -> list[Parameter]:
    """Return a parameter for each field of a record that declares limits."""
    defaults = record()
    return [
        Parameter(name, getattr(defaults, name), description, (low, high))
        for name, hint in get_type_hints(record, include_extras=True).items()
        for description, low, high in [hint.__metadata__]
    ]


def limited(record: type[_Record]) -> type[_Record]:
    """Let the constructor of a record, a NamedTuple, refuse what is beyond its fields' limits.

    `_make` and `_replace` check nothing: they are for values that are known to be good.
    """
    rows = parameters_of(record)
    make: Any = record.__new__
    make.__annotations__ = get_type_hints(record)  # what `help` shows

    def new(cls: type[_Record], *values: Any, **named: Any) -> _Record:  # noqa: ANN401 (any field)
        made: _Record = make(cls, *values, **named)
        for row in rows:
            row.check(getattr(made, row.name))
        return made

    new.__wrapped__ = make  # type: ignore[attr-defined]
    record.__new__ = new  # type: ignore[assignment]
    return record


limited(Vehicle)  # here, as a model that is handed in imports nothing of ours
