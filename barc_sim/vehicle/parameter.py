"""A named value that can be set from outside: its default, range and meaning."""

from __future__ import annotations

from typing import NamedTuple


class Parameter(NamedTuple):
    """A parameter of a node; `between` bounds a number, ends included, and so keeps NaN out."""

    name: str
    default: float | str | bool
    description: str
    between: tuple[float, float] | None = None
    read_only: bool = False
