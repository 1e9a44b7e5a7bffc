"""A quantity over time or place, by a number, a function or a file."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import pytest

from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import ROWS
from barc_sim.vehicle.profile import Profile, Signal, signal

if TYPE_CHECKING:
    from pathlib import Path


def force(given: object) -> Signal:
    return signal(given, ROWS['disturbance'], 'force_n')


@pytest.mark.parametrize(
    ('at', 'value'),
    [(-1.0, 1.0), (0.0, 1.0), (2.5, 2.0), (5.0, 7.0), (7.0, 8.0), (9.0, 9.0), (99.0, 9.0)],
)
def test_a_profile_is_straight_between_points_and_level_outside(at: float, value: float) -> None:
    points, values = (0.0, 5.0, 5.0, 9.0), (1.0, 3.0, 7.0, 9.0)
    assert Profile('time_s', points, values)(at, nan) == value
    assert Profile('distance_m', points, values)(nan, at) == value
    assert Profile('time_s', (3.0,), (2.0,))(at, 0.0) == 2.0


def test_a_file_names_what_it_is_over(tmp_path: Path) -> None:
    file = tmp_path / 'gust.csv'
    file.write_text('# a gust\ndistance_m, force_n\n\n10,0\n20,-500\n', encoding='utf-8')
    assert force(file)(0.0, 15.0) == force(str(file))(99.0, 15.0) == -250.0


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('', "its header is '', not 'time_s,force_n' or 'distance_m,force_n'"),
        ('time_s,speed_mps\n0,1\n', "its header is 'time_s,speed_mps', not"),
        ('time_s,force_n\n', 'it has no numbers below its header'),
        ('time_s,force_n\n0\n', "'0' must be two numbers, time_s,force_n"),
        ('time_s,force_n\n0,nan\n', 'disturbance: nan is not a number from -1e+06 to 1e+06'),
        ('time_s,force_n\n1,0\n0,0\n', '0 must not lie before 1'),
        ('time_s,force_n\n0,0\nnan,0\n', 'nan must not lie before 0'),
    ],
)
def test_a_file_that_is_no_profile_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / 'gust.csv'
    file.write_text(text, encoding='utf-8')
    with pytest.raises(UserError, match=r"gust.csv'") as refusal:
        force(file)
    assert complaint in str(refusal.value)
    with pytest.raises(UserError, match=r'disturbance .* is no CSV file'):
        force('nowhere.csv')


def test_what_a_function_returns_is_in_the_limits() -> None:
    assert force(lambda t, x: 2.0 * t + x)(3.0, 4.0) == 10.0
    with pytest.raises(UserError, match=r'disturbance after 3.000 s, at 4.000 m: 1e\+09 is not'):
        force(lambda *_: 1e9)(3.0, 4.0)
