"""Figures with the bounds that they must keep, and their table."""

from __future__ import annotations

import os
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


class Figure(NamedTuple):
    """One figure; its name ends with its unit."""

    name: str
    value: float
    maximum: float = inf
    minimum: float = -inf

    @property
    def is_within_bounds(self) -> bool:
        """Whether it is within its bounds; NaN is not."""
        return self.minimum <= self.value <= self.maximum

    def __str__(self) -> str:
        """Return a line of the table."""
        bounds = []
        if self.minimum > -inf:
            bounds.append(f'at least {self.minimum:g}')
        if self.maximum < inf:
            bounds.append(f'at most {self.maximum:g}')

        line = f'{self.name:52}{self.value:>12.6g}   {", ".join(bounds)}'
        if not self.is_within_bounds:
            line += '   BROKEN'
        return line.rstrip()


def spread(name: str, values: Sequence[float], maximum: float = inf) -> Iterator[Figure]:
    """Yield median, percentiles and the greatest of `values`, which may be `maximum` at most."""
    if values:
        for share in (50, 90, 99):
            yield Figure(f'{name}, p{share}', float(np.percentile(values, share)))
        yield Figure(f'{name}, greatest', max(values), maximum)


def table(figures: Sequence[Figure]) -> str:
    """Return a line for each figure."""
    return '\n'.join(map(str, figures))


def memory() -> int:
    """Return the resident memory of this process [bytes]."""
    pages = Path('/proc/self/statm').read_text(encoding='ascii').split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')
