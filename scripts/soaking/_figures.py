"""Figures with the bounds that they are to keep, and their table."""

from __future__ import annotations

import os
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


class Figure(NamedTuple):
    """One figure; `name` bears its unit."""

    name: str
    value: float
    most: float = inf
    least: float = -inf

    @property
    def kept(self) -> bool:
        """Whether it is within its bounds; NaN is not."""
        return self.least <= self.value <= self.most

    def __str__(self) -> str:
        """Return a line of the table."""
        bounds = [
            f'{words} {bound:g}'
            for words, bound in (('at least', self.least), ('at most', self.most))
            if abs(bound) < inf
        ]
        broken = '' if self.kept else '   BROKEN'
        return f'{self.name:52}{self.value:>12.6g}   {", ".join(bounds)}{broken}'.rstrip()


def spread(name: str, values: Sequence[float], most: float = inf) -> Iterator[Figure]:
    """Yield median, percentiles and the greatest of `values`, which is to be `most` at most."""
    if values:
        for share in (50, 90, 99):
            yield Figure(f'{name}, p{share}', float(np.percentile(values, share)))
        yield Figure(f'{name}, greatest', max(values), most)


def table(figures: Sequence[Figure]) -> str:
    """Return a line for each figure."""
    return '\n'.join(map(str, figures))


def memory() -> int:
    """Return the resident memory of this process [bytes]."""
    pages = Path('/proc/self/statm').read_text(encoding='ascii').split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')
