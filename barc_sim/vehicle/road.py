"""The road: grade, elevation and place on the map by distance along its surface."""

from __future__ import annotations

import csv
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, isfinite, radians, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STEEPEST_DEG = 90.0


class RoadPoint(NamedTuple):
    """A point of a road; arrays, of many."""

    theta_deg: float  #: [deg] incline, positive uphill
    sin_theta: float  #: the sine of it
    elevation: float  #: [m] above the first stretch's start


@dataclass(frozen=True)
class Road:
    """Stretches of constant grade; each owns its left end, the first and last have no outer end.

    `starts[i]` [m] is where the stretch of grade `grades_deg[i]` [deg] begins.

    Examples
    --------
    >>> road = Road((0.0, 20.0, 40.0), (0.0, 10.0, 0.0))
    >>> road.grade_deg(30.0), round(road.elevation(40.0), 2)
    (10.0, 3.47)
    """

    starts: tuple[float, ...]
    grades_deg: tuple[float, ...]
    name: str = 'road'
    _sines: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _heights: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _lengths: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raise ValueError unless starts rise and each stretch has a grade within ±90°."""
        if not self.starts or len(self.starts) != len(self.grades_deg):
            raise ValueError(
                f'{len(self.starts)} starts and {len(self.grades_deg)} grades must be equally '
                'many, and at least one of each'
            )
        for value in (*self.starts, *self.grades_deg):
            if not isfinite(value):
                raise ValueError(f'{value!r} is not a finite number')
        for left, right in pairwise(self.starts):
            if not left < right:
                raise ValueError(f'start {right!r} m must lie beyond the one before it, {left!r} m')
        for grade in self.grades_deg:
            if not abs(grade) < STEEPEST_DEG:
                raise ValueError(f'grade {grade!r} must lie between -90 and 90 degrees')
        sines = tuple(sin(radians(grade)) for grade in self.grades_deg)
        heights, lengths = [0.0], [0.0]
        for i, (left, right) in enumerate(pairwise(self.starts)):
            heights.append(heights[-1] + (right - left) * sines[i])
            lengths.append(lengths[-1] + (right - left) * cos(radians(self.grades_deg[i])))
        object.__setattr__(self, '_sines', sines)
        object.__setattr__(self, '_heights', tuple(heights))
        object.__setattr__(self, '_lengths', tuple(lengths))

    @classmethod
    def lab(cls) -> Road:
        """Return the lab's road: two hills, of 10° and of 30°."""
        return cls(
            starts=tuple(20.0 * i for i in range(9)),
            grades_deg=(0.0, 10.0, 0.0, -10.0, 0.0, 30.0, 0.0, -30.0, 0.0),
            name='lab',
        )

    @classmethod
    def flat(cls) -> Road:
        """Return a level road."""
        return cls(starts=(0.0,), grades_deg=(0.0,), name='flat')

    @classmethod
    def named(cls, name: str) -> Road:
        """Return the road called `lab` or `flat`, or the one in the CSV file of that name.

        The file has the columns `start_m,grade_deg`, in that order, under such a header; blank
        lines and lines beginning with `#` are passed over.

        Raises
        ------
        UserError
            where there is no such road, or the file does not describe one.
        """
        if name in ('lab', 'flat'):
            return cls.lab() if name == 'lab' else cls.flat()
        path = Path(name)
        try:
            # Spreadsheets on Windows begin UTF-8 with a byte order mark.
            lines = read_regular(path, 1 << 24).decode('utf-8-sig').splitlines()
        except (OSError, ValueError):
            raise UserError(
                f"road {name!r} is neither 'lab', 'flat' nor a CSV file that can be read"
            ) from None
        try:
            stretches = _stretches(lines)
            return cls(
                starts=tuple(start for start, _ in stretches),
                grades_deg=tuple(grade for _, grade in stretches),
                name=name,
            )
        except (ValueError, csv.Error) as error:
            raise UserError(f'road file {name!r} describes no road: {error}') from None

    def _stretch(self, s: float) -> int:
        return max(bisect_right(self.starts, s) - 1, 0)

    def grade_deg(self, s: float) -> float:
        """Return the incline [deg] at `s` metres along the road, positive uphill."""
        return self.grades_deg[self._stretch(s)]

    def elevation(self, s: float) -> float:
        """Return the height [m] at `s` metres along the road, above the first stretch's start."""
        return self.at(s).elevation

    def at(self, s: float) -> RoadPoint:
        """Return the point at `s` metres along the road."""
        i = self._stretch(s)
        sine = self._sines[i]
        elevation = self._heights[i] + (s - self.starts[i]) * sine
        return RoadPoint(self.grades_deg[i], sine, elevation)

    def profile(self, s: Floats) -> RoadPoint:
        """Return the points at `s` [m]; each array has its shape, `(n,)`."""
        import numpy as np  # noqa: PLC0415 (a road alone does not need it)

        table = self.starts, self.grades_deg, self._sines, self._heights
        i = np.maximum(np.searchsorted(self.starts, s, side='right') - 1, 0)
        starts, grades, sines, heights = (np.array(each)[i] for each in table)
        points: Any = grades, sines, heights + (s - starts) * sines
        return RoadPoint(*points)

    def horizontal(self, s: float) -> float:
        """Return how far [m] `s` metres along the road are on the map, from where `s` is zero.

        It is the integral of cos(theta) over the distance along the surface: 20 m at 10° are
        19.696 m on the map.
        """
        return self._length(s) - self._length(0.0)

    def _length(self, s: float) -> float:
        i = self._stretch(s)
        return self._lengths[i] + (s - self.starts[i]) * cos(radians(self.grades_deg[i]))


def _stretches(lines: list[str]) -> list[tuple[float, float]]:
    """Return start [m] and grade [deg] of each row of a road file."""
    content = [line for line in lines if line.strip() and line.lstrip()[0] != '#']
    header, *rows = [*csv.reader(content)] or [[]]
    if [column.strip() for column in header] != ['start_m', 'grade_deg']:
        raise ValueError(f"its header is {','.join(header)!r}, not 'start_m,grade_deg'")
    return [_numbers(row) for row in rows]


def _numbers(row: list[str]) -> tuple[float, float]:
    try:
        start, grade = (float(cell) for cell in row)
    except ValueError:
        raise ValueError(
            f'{",".join(row)!r} must be two numbers, distance [m] and grade [deg]'
        ) from None
    return start, grade
