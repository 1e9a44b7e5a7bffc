"""The road, by distance along its surface; and any other quantity over time or place.

A disturbance or a speed is a number, a function or a CSV file.
"""

from __future__ import annotations

import csv
from bisect import bisect_right
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, isfinite, radians, sin
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.errors import Parameter

    Floats = NDArray[np.float64]
    Column = tuple[float, ...]
    Places = TypeVar('Places', float, Floats)


_Read = TypeVar('_Read')
STEEPEST_DEG = 90.0
_MAX_SIZE = 1 << 24  #: [B] of a file


class RoadPoint(NamedTuple):
    """A point of a road; the fields can be arrays of many points."""

    theta_deg: float  #: [deg] incline, positive uphill
    sin_theta: float  #: the sine of it
    elevation: float  #: [m] above the first stretch's start


@dataclass(frozen=True)
class Road:
    """Stretches of constant grade; the first and the last one extend without end.

    `starts[i]` [m] is the start of the stretch with the grade `grades_deg[i]` [deg], and belongs to
    it.

    Examples
    --------
    >>> road = Road((0.0, 20.0, 40.0), (0.0, 10.0, 0.0))
    >>> road.grade_deg(30.0), round(road.elevation(40.0), 2)
    (10.0, 3.47)
    """

    starts: tuple[float, ...]
    grades_deg: tuple[float, ...]
    name: str = 'road'
    _sines: Column = field(init=False, repr=False, compare=False)
    _cosines: Column = field(init=False, repr=False, compare=False)
    _heights: Column = field(init=False, repr=False, compare=False)
    _lengths: Column = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raise UserError unless starts rise and each stretch has a grade within ±90°."""
        for name in ('starts', 'grades_deg'):  # arrays, too
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        if not self.starts or len(self.starts) != len(self.grades_deg):
            raise UserError(
                f'{len(self.starts)} starts and {len(self.grades_deg)} grades: expected the same '
                'number of both, at least one'
            )
        for value in (*self.starts, *self.grades_deg):
            if not isfinite(value):
                raise UserError(f'{value!r} is not a finite number')
        for left, right in pairwise(self.starts):
            if not left < right:
                raise UserError(f'start {right!r} m must lie beyond the one before it, {left!r} m')
        for grade in self.grades_deg:
            if not abs(grade) < STEEPEST_DEG:
                raise UserError(f'grade {grade!r} must lie between -90 and 90 degrees')
        sines = tuple(sin(radians(grade)) for grade in self.grades_deg)
        cosines = tuple(cos(radians(grade)) for grade in self.grades_deg)
        heights, lengths = [0.0], [0.0]
        for i, (left, right) in enumerate(pairwise(self.starts)):
            heights.append(heights[-1] + (right - left) * sines[i])
            lengths.append(lengths[-1] + (right - left) * cosines[i])
        object.__setattr__(self, '_sines', sines)
        object.__setattr__(self, '_cosines', cosines)
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

        The file has the header `start_m,grade_deg` and these two columns; blank lines and lines
        that begin with `#` are skipped.

        Raises
        ------
        UserError
            if there is no such road, or the file does not describe one.
        """
        if name in ('lab', 'flat'):
            return cls.lab() if name == 'lab' else cls.flat()

        def read(lines: list[str]) -> Road:
            _, starts, grades_deg = read_columns(lines, 'start_m,grade_deg')
            return cls(starts, grades_deg, name)

        return read_named('road', name, ('lab', 'flat'), read)

    @classmethod
    def of(cls, road: Road | str | PathLike[str]) -> Road:
        """Return `road` itself, or the one of that name."""
        return road if isinstance(road, Road) else cls.named(str(road))

    def stretch(self, s: float) -> int:
        """Return the number of the stretch at `s` metres along the road."""
        return max(bisect_right(self.starts, s) - 1, 0)

    def grade_deg(self, s: Places) -> Places:
        """Return the incline [deg] at `s` metres along the road, positive uphill.

        An array of positions gives an array, also in `elevation`, `horizontal` and `at`.
        """
        if isinstance(s, (float, int)):
            return self.grades_deg[self.stretch(s)]
        return self._many(s, self.grades_deg)[0]

    def elevation(self, s: Places) -> Places:
        """Return the height [m] at `s` metres along the road, above the first stretch's start."""
        return self.at(s).elevation  # type: ignore[return-value]  # arrays of arrays

    def at(self, s: float | Floats) -> RoadPoint:
        """Return the point at `s` metres along the road."""
        if isinstance(s, (float, int)):
            i = self.stretch(s)
            sine = self._sines[i]
            elevation = self._heights[i] + (s - self.starts[i]) * sine
            return RoadPoint(self.grades_deg[i], sine, elevation)
        table = self.starts, self.grades_deg, self._sines, self._heights
        starts, grades, sines, heights = self._many(s, *table)
        points: Any = grades, sines, heights + (s - starts) * sines
        return RoadPoint(*points)

    def horizontal(self, s: Places) -> Places:
        """Return the horizontal distance [m] from s = 0 to `s` metres along the road.

        It is the integral of cos(theta) over the distance along the surface: 20 m at 10° are
        19.696 m on the map.
        """
        return self._length(s) - self._length(0.0)

    def _length(self, s: Places) -> Places:
        if isinstance(s, (float, int)):
            i = self.stretch(s)
            return self._lengths[i] + (s - self.starts[i]) * self._cosines[i]
        starts, lengths, cosines = self._many(s, self.starts, self._lengths, self._cosines)
        return lengths + (s - starts) * cosines

    def _many(self, s: Floats, *columns: Column) -> list[Floats]:
        """Return the values of the stretches at `s` [m], of each column."""
        import numpy as np  # noqa: PLC0415 (a road alone does not need it)

        i = np.maximum(np.searchsorted(self.starts, s, side='right') - 1, 0)
        return [np.array(column)[i] for column in columns]


def read_named(
    what: str, name: str, known: Iterable[str], read: Callable[[list[str]], _Read]
) -> _Read:
    """Return the object that `read` makes of a file's lines; UserError: it cannot be read."""
    try:
        lines = read_lines(Path(name))
    except (OSError, ValueError):
        names = ', '.join(map(repr, known))
        raise UserError(
            f'{what} {name!r} is neither {names} nor a CSV file that can be read'
        ) from None
    try:
        return read(lines)
    except (ValueError, csv.Error) as error:
        raise UserError(f'{what} file {name!r} describes no {what}: {error}') from None


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file; spreadsheets on Windows begin it with a byte order mark."""
    return read_regular(path, _MAX_SIZE).decode('utf-8-sig').splitlines()


def read_columns(lines: list[str], *headers: str) -> tuple[Any, ...]:
    """Return the header of a CSV file, one of `headers`, and its columns of numbers.

    Blank lines and lines that begin with `#` are skipped; the header may follow a `#`.
    """
    read = (line.lstrip('# ') if line.lstrip('# ') in headers else line for line in lines)
    content = [line for line in read if line.strip() and line.lstrip()[0] != '#']
    first, *rows = [*csv.reader(content)] or [[]]
    header = ','.join(column.strip() for column in first)
    if header not in headers:
        raise ValueError(f'its header is {header!r}, not {" or ".join(map(repr, headers))}')
    if not rows:
        raise ValueError('it has no numbers below its header')
    return header, *zip(*(_numbers(row, header) for row in rows), strict=True)


def _numbers(row: list[str], header: str) -> list[float]:
    names = header.split(',')
    with suppress(ValueError):
        numbers = [float(cell) for cell, _ in zip(row, names, strict=True)]
        if all(map(isfinite, numbers)):
            return numbers
    raise ValueError(f'{",".join(row)!r} must be {len(names)} finite numbers, {header}')


#: A function of time since the start [s] and position along the road [m].
Signal = Callable[[float, float], float]
_OVER = ('time_s', 'distance_m')


@dataclass(frozen=True)
class Profile:
    """Linear interpolation of points over `time_s` or `distance_m`; constant before and after them.

    Two points at one time or distance are a step.

    Examples
    --------
    >>> profile = Profile('time_s', (0.0, 10.0, 10.0), (0.0, 8.0, 5.0))
    >>> profile(5.0, 0.0), profile(10.0, 0.0)
    (4.0, 5.0)
    """

    over: str
    points: tuple[float, ...]
    values: tuple[float, ...]

    def __call__(self, t: float, x: float) -> float:
        """Return the value after `t` seconds, or at `x` metres along the road."""
        at = t if self.over == 'time_s' else x
        i = bisect_right(self.points, at)
        if i in (0, len(self.points)):
            return self.values[max(i - 1, 0)]
        left, right = self.points[i - 1], self.points[i]
        share = (at - left) / (right - left)
        return (1.0 - share) * self.values[i - 1] + share * self.values[i]


def signal(given: object, row: Parameter, column: str) -> Signal:
    """Return a function of time and position from a user's number, function or CSV file.

    A file has two columns: `time_s` or `distance_m`, and `column`. Values are in the limits of
    `row`.

    Raises
    ------
    UserError
        if there is no such file, or a value is out of the limits; the function raises it, too.
    """
    if callable(given):

        def checked(t: float, x: float) -> float:
            value = given(t, x)
            row.check(value, f'{row.name} after {t:.3f} s, at {x:.3f} m')
            return float(value)

        return checked
    if not isinstance(given, (str, PathLike)):
        row.check(given)
        return lambda *_: float(given)  # type: ignore[arg-type]  # a number
    name = str(given)
    try:
        lines = read_lines(Path(name))
    except (OSError, ValueError):
        raise UserError(f'{row.name} {name!r} is not a readable CSV file') from None
    try:
        header, points, values = read_columns(lines, *(f'{over},{column}' for over in _OVER))
        for value in values:
            row.check(value)
    except (ValueError, csv.Error) as error:
        raise UserError(f'file {name!r}: {error}') from None
    for left, right in pairwise(points):
        if not left <= right:
            raise UserError(f'file {name!r}: {right:g} must not be below {left:g}')
    return Profile(header.partition(',')[0], points, values)
