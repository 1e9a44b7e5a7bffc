"""What a task observes ahead of a car: the curvature of a track, or the incline of a road."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.vehicle.law import law
from barc_sim.vehicle.track import in_lap

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Column = Any  #: a list or tuple of numbers in Python, an array in compiled code

#: [m] where the road ahead is observed: its curvature or its incline.
AHEAD = (0.0, 5.0, 10.0, 15.0, 20.0)


class PreviewTable(NamedTuple):
    """The values of a course at each of `AHEAD`, as a law takes them."""

    edges: Column  #: [m] places, in order, where a value changes
    rows: Column  #: the values before the first edge, between two, and beyond the last
    length: float  #: [m] of the course
    is_closed: bool


@law
def row_at(table: PreviewTable, s: float, near: int) -> int:
    """Return the number of the row for a place [m]; `near` is one not far from it."""
    s = in_lap(table, s)
    edges = table.edges
    while near < len(edges) and s >= edges[near]:
        near += 1
    while near > 0 and s < edges[near - 1]:
        near -= 1
    return near


class Preview:
    """The values of a course at each of `AHEAD` from a place: a function of s [m].

    The values are constant between `starts` [m], whose last one is the length if the course
    `is_closed`. So they change only where one of `AHEAD` reaches a start, and are a table.

    Attributes
    ----------
    table
        The record that `row_at` takes.
    """

    def __init__(
        self, starts: Sequence[float], at: Callable[[Floats], Floats], is_closed: bool = False
    ) -> None:
        """Tabulate the values that `at` returns for places [m]."""
        length = starts[-1]
        places = np.subtract.outer(starts, AHEAD)
        if is_closed:
            edges = np.unique(places % length)
            first = 0.0
            last = length
        else:
            edges = np.unique(places)
            first = edges[0] - 1.0
            last = edges[-1] + 1.0

        middles = 0.5 * (np.append(first, edges) + np.append(edges, last))
        rows = at(np.add.outer(AHEAD, middles)).T
        self.table = PreviewTable(edges.tolist(), [*map(tuple, rows.tolist())], length, is_closed)

    def __call__(self, s: float) -> tuple[float, ...]:
        """Return the values ahead of `s` [m]."""
        table = self.table
        row = bisect_right(table.edges, in_lap(table, s))
        values: tuple[float, ...] = table.rows[row]
        return values


def with_preview_arrays(table: PreviewTable) -> PreviewTable:
    """Return a table as compiled loops take it: its columns are arrays."""
    return table._replace(edges=np.array(table.edges), rows=np.array(table.rows))
