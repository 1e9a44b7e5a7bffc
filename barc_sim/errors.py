"""Errors of a user as one sentence; the limits of numbers; text that is safe to show.

There is one table of limits: a record declares its fields as `Annotated[float, description, low,
high]`, and `parameters_of` returns a `Parameter` for each. Constructors, `simulate`, nodes and
options of commands check values against them, with the sentence of `not_between`.
"""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from math import inf
from numbers import Integral, Real
from typing import Annotated, Any, NamedTuple, TypeVar, get_origin, get_type_hints

#: The bounds of a text or a flag: there are none.
ANY = (-inf, inf)
_Record = TypeVar('_Record', bound=tuple[Any, ...])


def escaped(text: str) -> str:
    """Return `text` with the characters that control a terminal written as escapes."""
    return ''.join(
        c if c.isprintable() or c in '\n\t' else c.encode('unicode_escape').decode() for c in text
    )


def without_addresses(text: str) -> str:
    """Return `text` without addresses in memory, which differ from run to run."""
    return re.sub(r' at 0x[0-9a-fA-F]+', '', text)


def one_line(text: str, width: int = 400) -> str:
    """Return `text` as one line of at most `width` characters, escaped."""
    line = ' '.join(escaped(text).split())
    return line if len(line) <= width else f'{line[: width - 1]}\N{HORIZONTAL ELLIPSIS}'


def not_between(value: object, low: float, high: float) -> str:
    """Return why `value` is not a number from `low` to `high`, ends included; '' if it is one.

    If `low` is an int, the number must be whole.

    Examples
    --------
    >>> not_between(-1.0, 0.0, 1e3), not_between(1.5, 0, 9)
    ('-1 is not a number from 0 to 1000', '1.5 is not a whole number from 0 to 9')
    """
    whole = isinstance(low, int)
    kinds = (int, Integral) if whole else (float, int, Real)  # the first are quick to find
    if isinstance(value, kinds) and not isinstance(value, bool) and low <= value <= high:  # type: ignore[operator]
        return ''
    shown = f'{value:g}' if isinstance(value, float) and not whole else repr(value)
    span = f'from {low:g} to {high:g}'
    if whole:
        span = f'of at least {low}' if high == inf else f'from {low} to {high}'
    return f'{shown} is not a {"whole " * whole}number {span}'


class UserError(ValueError):
    """Names the value, what was expected and what to do; ends a command with exit code 2.

    Its text is shown on terminals, and names can come from a bag: they are escaped.

    Examples
    --------
    >>> print(UserError('kp=inf must be finite'))
    kp=inf must be finite
    """

    def __init__(self, message: str = '') -> None:
        super().__init__(escaped(message))


def extra(module: str, user: str, name: str) -> Any:  # noqa: ANN401 (a module)
    """Import and return an optional package's module; UserError: it is not installed.

    `user` is what needs it, and `name` the extra of barc_sim that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition('.')[0]
        raise UserError(
            f"{user} needs {package}, which is not installed: pip install 'barc_sim[{name}]'"
        ) from None


class Parameter(NamedTuple):
    """A parameter of a node; `between` bounds a number, ends included, and so keeps NaN out."""

    name: str
    default: float | str | bool
    description: str
    between: tuple[float, float] = ANY
    read_only: bool = False

    @property
    def unit(self) -> str:
        """The unit, which stands in brackets in the description; empty without one."""
        unit = re.search(r'\[([^]]+)\]', self.description)
        return unit[1] if unit else ''

    def check(self, value: object, name: str = '') -> None:
        """Raise UserError if `value`, given as the argument `name`, is not `between` the bounds."""
        if self.between != ANY and (why := not_between(value, *self.between)):
            raise UserError(f'{name or self.name}: {why}')


def parameters_of(record: type[Any]) -> list[Parameter]:
    """Return a parameter for each field of a NamedTuple or dataclass that declares its meaning.

    A field is `Annotated[kind, description]`, `Annotated[kind, description, low, high]`, or
    `Annotated[kind, parameter]`, which shares meaning and limits of another parameter.
    """
    if is_dataclass(record):
        defaults = {each.name: each.default for each in fields(record)}
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
    meaning: str | Parameter,
    low: float = -inf,
    high: float = inf,
) -> Parameter:
    if isinstance(meaning, Parameter):
        return meaning._replace(name=name, default=default)
    return Parameter(name, default, meaning, (low, high))


def limited(record: type[_Record]) -> type[_Record]:
    """Make the constructor of a record, a NamedTuple, refuse values beyond its fields' limits.

    `_make` and `_replace` check nothing: they are for values that have been checked.
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
