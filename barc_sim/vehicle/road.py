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

from barc_sim.cli.files import decoded, read_regular
from barc_sim.cli.limits import not_between
from barc_sim.cli.text import one_line
from barc_sim.errors import UserError
from barc_sim.vehicle.law import law

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.interfaces.parameters import ParameterDeclaration

    Floats = NDArray[np.float64]
    Column = tuple[float, ...]
    Places = TypeVar('Places', float, Floats)


_Read = TypeVar('_Read')
STEEPEST_DEG = 90.0
_MAX_SIZE = 1 << 24  #: [B] of a file
_DELIMITERS = ',;\t'
_SHOWN = 80  #: characters of a line in a sentence


class RoadPoint(NamedTuple):
    """A point of a road; the fields can be arrays of many points."""

    theta_deg: float  #: [deg] incline, positive uphill
    sin_theta: float  #: the sine of it
    elevation: float  #: [m] above the first stretch's start


class Inclines(NamedTuple):
    """The inclines of a road, as the laws take them.

    The columns are tuples or lists of numbers; in compiled code, arrays.
    """

    starts: Any  #: [m] of the stretches
    thetas: Any  #: [rad] of the stretches
    is_held: bool = False  #: a step has the incline of the place where it began, as on a track


#: A flat road.
LEVEL = Inclines((0.0,), (0.0,))


@law
def stretch_at(starts: Any, x: float, near: int) -> int:  # noqa: ANN401 (a column)
    """Return the number of the stretch at `x` [m], which is `near` or not far from it."""
    while near + 1 < len(starts) and x >= starts[near + 1]:
        near += 1
    while near > 0 and x < starts[near]:
        near -= 1
    return near


@law
def theta_at(inclines: Inclines, stretch: int, x: float) -> float:
    """Return the incline [rad] at `x` [m], in a step that began on the stretch of this number."""
    if not inclines.is_held:
        stretch = stretch_at(inclines.starts, x, stretch)
    theta: float = inclines.thetas[stretch]
    return theta


@dataclass(frozen=True)
class Road:
    """Stretches of constant grade; the first and the last one extend without end.

    Parameters
    ----------
    starts
        [m] start of each stretch along the road, in order; the start belongs to its stretch.
    grades_deg
        [deg] grade of each stretch, positive uphill.
    name
        Its name in figures and bags.

    Raises
    ------
    UserError
        if the starts do not rise, or a grade is not between -90° and 90°.

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
        for i, (left, right) in enumerate(pairwise(self.starts), 1):
            if not left < right:
                raise RowError(
                    i, f'start {right!r} m must lie beyond the one before it, {left!r} m'
                )
        for i, grade in enumerate(self.grades_deg):
            if not abs(grade) < STEEPEST_DEG:
                raise RowError(i, f'grade {grade!r} must lie between -90 and 90 degrees')

        sines = tuple(sin(radians(grade)) for grade in self.grades_deg)
        cosines = tuple(cos(radians(grade)) for grade in self.grades_deg)
        heights = [0.0]
        lengths = [0.0]
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
        that begin with `#` are skipped. Semicolons and tabs can separate the columns, too.

        Raises
        ------
        UserError
            if there is no such road, or the file does not describe one.
        """
        if name in ('lab', 'flat'):
            return cls.lab() if name == 'lab' else cls.flat()

        def read(table: Table) -> Road:
            starts, grades_deg = table.columns
            return cls(starts, grades_deg, name)

        return read_named('road', name, ('lab', 'flat'), read, 'start_m,grade_deg')

    @classmethod
    def of(cls, road: Road | str | PathLike[str]) -> Road:
        """Return `road` itself, or the one of that name."""
        return road if isinstance(road, Road) else cls.named(str(road))

    def inclines(self, *, is_held: bool = False) -> Inclines:
        """Return the inclines, as the laws take them."""
        return Inclines(self.starts, tuple(map(radians, self.grades_deg)), is_held)

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

    def along(self, horizontal: float) -> float:
        """Return the distance [m] along the road that is `horizontal` metres on the map."""
        length = horizontal + float(self._length(0.0))
        i = max(bisect_right(self._lengths, length) - 1, 0)
        return self.starts[i] + (length - self._lengths[i]) / self._cosines[i]

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


class RowError(UserError):
    """An error in one of many values; a reader adds its line in the file."""

    def __init__(self, index: int, reason: str) -> None:
        """Take the number of the value, from 0, and what is wrong with it."""
        super().__init__(reason)
        self.index = index


class Table(NamedTuple):
    """The columns of numbers in a CSV file."""

    header: str
    columns: tuple[Column, ...]
    lines: tuple[int, ...]  #: numbers of the lines of the rows, from 1
    rows: tuple[str, ...]  #: their text


def read_named(
    kind: str, name: str, built_in: Iterable[str], read: Callable[[Table], _Read], *headers: str
) -> _Read:
    """Return the object, such as a road, that `read` makes of the table in the file `name`.

    UserError: it cannot be read, and is none of the `built_in` names.
    """
    try:
        lines = read_lines(Path(name))
    except (OSError, ValueError):
        names = ', '.join(map(repr, built_in))
        raise UserError(
            f'{kind} {name!r} is neither {names} nor a CSV file that can be read'
        ) from None
    try:
        return read_table(lines, read, *headers)
    except ValueError as error:
        raise UserError(f'{kind} file {name!r} describes no {kind}: {error}') from None


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file, in the encodings that spreadsheets write."""
    return decoded(read_regular(path, _MAX_SIZE)).splitlines()


def read_table(lines: list[str], read: Callable[[Table], _Read], *headers: str) -> _Read:
    """Return what `read` makes of the columns of a CSV file whose header is one of `headers`.

    Blank lines and lines that begin with `#` are skipped; the header may follow a `#`. ValueError
    names the line and its text if a row is wrong.
    """
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    wrong_header = ''
    for i, (_, line) in enumerate(numbered):
        delimiter = max(_DELIMITERS, key=line.count)
        header = ','.join(_cells(line.lstrip('# \t'), delimiter))
        if header in headers:
            rows = [row for row in numbered[i + 1 :] if not _is_comment(row[1])]
            return _read_rows(header, rows, delimiter, read)

        # The header that is named in the error: a comment is one only if it has several cells.
        may_be_header = not _is_comment(line) or delimiter in line
        if may_be_header and not (wrong_header and _is_number(header)):
            wrong_header = header
        if not _is_comment(line):
            break
    expected = ' or '.join(map(repr, headers))
    raise ValueError(f'its header is {one_line(wrong_header, _SHOWN)!r}, not {expected}')


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith('#')


def _is_number(header: str) -> bool:
    """Return whether a line begins with a number, and so is no header."""
    try:
        float(header.partition(',')[0])
    except ValueError:
        return False
    return True


def _read_rows(
    header: str, rows: list[tuple[int, str]], delimiter: str, read: Callable[[Table], _Read]
) -> _Read:
    """Return what `read` makes of the rows below a header: the number and text of each line."""
    if not rows:
        raise ValueError('it has no numbers below its header')
    numbers, texts = zip(*rows, strict=True)
    cells = [_numbers(number, text, header, delimiter) for number, text in rows]
    try:
        return read(Table(header, tuple(zip(*cells, strict=True)), numbers, texts))
    except RowError as error:
        number = numbers[error.index]
        text = one_line(texts[error.index], _SHOWN)
        raise ValueError(f'line {number}, {text!r}: {error}') from None


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without the spaces around them."""
    try:
        (cells,) = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    except (ValueError, csv.Error):
        return [line]
    return [cell.strip() for cell in cells]


def _numbers(number: int, line: str, header: str, delimiter: str) -> list[float]:
    """Return the numbers of a line; beside semicolons they may have a decimal comma."""
    names = header.split(',')
    cells = _cells(line, delimiter)
    if delimiter != ',':
        cells = [cell.replace(',', '.') for cell in cells]
    with suppress(ValueError):
        numbers = [float(cell) for cell, _ in zip(cells, names, strict=True)]
        if all(map(isfinite, numbers)):
            return numbers
    raise ValueError(
        f'line {number}, {one_line(line, _SHOWN)!r}, must be {len(names)} finite numbers, {header}'
    )


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

        left = self.points[i - 1]
        right = self.points[i]
        share = (at - left) / (right - left)
        return (1.0 - share) * self.values[i - 1] + share * self.values[i]


def signal(source: object, row: ParameterDeclaration, column: str) -> Signal:
    """Return a function of time and position from a user's number, function or CSV file.

    A file has two columns: `time_s` or `distance_m`, and `column`. Values are in the limits of
    `row`. A `Profile`, such as that of a file, is returned as it is.

    Parameters
    ----------
    source
        The number, the function, the `Profile` or the path of the file.
    row
        The parameter that the values are of.
    column
        The header of the values in a file.

    Returns
    -------
    callable
        A function of time [s] and position [m].

    Raises
    ------
    UserError
        if there is no such file, or a value is out of the limits; the function raises it, too.
    """
    if isinstance(source, Profile):
        for value in source.values:
            row.check(value)
        return source
    if callable(source):
        return _checked_function(source, row)
    if isinstance(source, (str, PathLike)):
        return _read_profile(str(source), row, column)
    row.check(source)
    constant = float(source)  # type: ignore[arg-type]  # a number, as it was checked

    def at_all_times(_t: float, _x: float) -> float:
        return constant

    return at_all_times


def _checked_function(function: Signal, row: ParameterDeclaration) -> Signal:
    """Return a user's function of time and position, whose values are checked."""

    def checked(t: float, x: float) -> float:
        value = function(t, x)
        row.check(value, f'{row.name} after {t:.3f} s, at {x:.3f} m')
        return float(value)

    return checked


def _read_profile(name: str, row: ParameterDeclaration, column: str) -> Profile:
    """Return the profile in a CSV file; UserError: it cannot be read, or is none."""
    try:
        lines = read_lines(Path(name))
    except (OSError, ValueError):
        raise UserError(f'{row.name} {name!r} is not a readable CSV file') from None

    def read(table: Table) -> Profile:
        return _profile(row, table)

    headers = [f'{over},{column}' for over in _OVER]
    try:
        return read_table(lines, read, *headers)
    except ValueError as error:
        raise UserError(f'file {name!r}: {error}') from None


def _profile(row: ParameterDeclaration, table: Table) -> Profile:
    """Return the profile of a table; RowError: a value is out of the limits, or a point too low."""
    points, values = table.columns
    for i, value in enumerate(values):
        refusal = not_between(value, *row.between)
        if refusal:
            raise RowError(i, f'{row.name}: {refusal}')
    for i, (left, right) in enumerate(pairwise(points), 1):
        if not left <= right:
            raise RowError(i, f'{right:g} must not be below {left:g}')
    return Profile(table.header.partition(',')[0], points, values)
