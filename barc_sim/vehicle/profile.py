"""A quantity over time or place, such as a disturbance: a number, a function or a CSV file."""

from __future__ import annotations

import csv
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.vehicle.road import read_lines, read_pairs

if TYPE_CHECKING:
    from barc_sim.vehicle.limits import Parameter

#: Of time since the start [s] and place along the road [m].
Signal = Callable[[float, float], float]
_OVER = ('time_s', 'distance_m')


@dataclass(frozen=True)
class Profile:
    """Straight lines through points over `time_s` or `distance_m`; level before and behind them.

    Two points at one place are a step.

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
    """Return the function of time and place that a user means by a number, function or CSV file.

    A file has two columns: `time_s` or `distance_m`, and `column`. Values are in the limits of
    `row`.

    Raises
    ------
    UserError
        where there is no such file, or a value is out of the limits; by the function, too.
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
        raise UserError(f'{row.name} {name!r} is no CSV file that can be read') from None
    try:
        header, points, values = read_pairs(lines, *(f'{over},{column}' for over in _OVER))
        for value in values:
            row.check(value)
    except (ValueError, csv.Error) as error:
        raise UserError(f'file {name!r}: {error}') from None
    for left, right in pairwise(points):
        if not left <= right:
            raise UserError(f'file {name!r}: {right:g} must not lie before {left:g}')
    return Profile(header.partition(',')[0], points, values)
