"""The road, and quantities over time or place."""

from __future__ import annotations

from math import hypot, inf, nan, nextafter, radians, sin
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import ROWS
from barc_sim.vehicle.road import Profile, Road, Signal, signal

if TYPE_CHECKING:
    from pathlib import Path


HEADER = 'start_m,grade_deg\n'
properties = settings(deadline=None, derandomize=True)


@st.composite
def roads(draw: st.DrawFn) -> Road:
    starts = sorted(draw(st.sets(st.integers(-500, 500), min_size=1, max_size=8)))
    grades = draw(st.lists(st.floats(-60.0, 60.0), min_size=len(starts), max_size=len(starts)))
    return Road(tuple(map(float, starts)), tuple(grades))


# The lab's road


@pytest.mark.parametrize(('stretch', 'grade_deg'), [*enumerate([0, 10, 0, -10, 0, 30, 0, -30, 0])])
def test_lab_road_has_the_labs_grades_and_each_stretch_owns_its_left_end(
    stretch: int, grade_deg: float
) -> None:
    start, end = 20.0 * stretch, 20.0 * (stretch + 1)
    for s in (start, (start + end) / 2, nextafter(end, 0.0)):
        assert Road.lab().grade_deg(s) == Road.lab().at(s)[0] == grade_deg


# Any road


@properties
@given(road=roads())
def test_elevation_is_the_integral_of_the_grades_sine(road: Road) -> None:
    begin, end = road.starts[0], road.starts[-1] + 20.0
    # Starts are whole metres, so that no midpoint falls on one.
    midpoints = np.arange(begin, end, 0.25) + 0.125
    slopes = [sin(radians(road.grade_deg(s))) for s in midpoints.tolist()]
    assert road.elevation(end) == pytest.approx(0.25 * sum(slopes), abs=1e-9)
    assert road.elevation(begin) == 0.0


@pytest.mark.parametrize(
    ('starts', 'grades_deg', 'message'),
    [
        ((), (), '0 starts and 0 grades: expected the same number of both, at least one'),
        ((0.0, 1.0), (0.0,), '2 starts and 1 grades: expected the same number of both'),
        ((0.0, nan), (0.0, 0.0), 'nan is not a finite number'),
        ((0.0,), (inf,), 'inf is not a finite number'),
        ((0.0, 20.0, 20.0), (0.0, 1.0, 2.0), r'start 20\.0 m must lie beyond .*, 20\.0 m'),
        ((0.0, -1.0), (0.0, 1.0), r'start -1\.0 m must lie beyond the one before it, 0\.0 m'),
        ((0.0,), (90.0,), r'grade 90\.0 must lie between -90 and 90 degrees'),
        ((0.0,), (-90.0,), r'grade -90\.0 must lie between'),
    ],
)
def test_an_invalid_road_is_refused(
    starts: tuple[float, ...], grades_deg: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Road(starts, grades_deg)


def test_arrays_make_a_road_and_are_places_on_it() -> None:
    road = Road(np.arange(4) * 10.0, np.array([0, 5, -3, 0]))
    assert road == Road((0.0, 10.0, 20.0, 30.0), (0.0, 5.0, -3.0, 0.0))
    places = np.array([[-5.0, 0.0, 10.0], [19.5, 30.0, 300.0]])
    for method in (road.grade_deg, road.elevation, road.horizontal):
        results = method(places)
        assert results.shape == places.shape
        assert results.ravel().tolist() == [method(s) for s in places.ravel().tolist()]


@pytest.mark.parametrize('road', [Road.lab(), Road.flat(), Road((5.0, 9.0), (20.0, -40.0))])
def test_a_place_on_the_map_is_found_along_the_road(road: Road) -> None:
    for s in (-30.0, 0.0, 3.0, 25.0, 110.0, 150.0, 400.0):
        assert road.along(road.horizontal(s)) == pytest.approx(s)


# By name


@pytest.mark.parametrize('road', [Road.lab(), Road.flat()])
def test_built_in_roads_are_found_by_their_names(road: Road) -> None:
    assert Road.named(road.name) == road


@pytest.mark.parametrize(
    'text',
    [
        b'start_m,grade_deg\n0,0\n15.5,-4\n',
        b'\xef\xbb\xbfstart_m,grade_deg\r\n0,0\r\n15.5,-4\r\n',
        b'\xef\xbb\xbf# made with a spreadsheet\r\nstart_m,grade_deg\r\n0,0\r\n15.5,-4',
        b'start_m , grade_deg\n 0 , 0\n 15.5 , -4\n',
        b'"start_m","grade_deg"\n"0","0"\n"15.5","-4"\n',
        b'start_m;grade_deg\r0;0\r15,5;-4\r',
        b'# von Zo\xeb\n# start_m; grade_deg\n0; 0\n15.5; -4\n',
        b'\n# a hill\n  # of ours\nstart_m,grade_deg\n\n0,0\n \n# steep, and long\n15.5,-4\n\n',
    ],
    ids=[
        'plain',
        'windows',
        'windows-comment',
        'spaces',
        'quoted',
        'semicolons',
        'latin-1',
        'comments-and-blank-lines',
    ],
)
def test_road_is_read_from_a_file(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / 'hill.csv'
    path.write_bytes(text)
    assert Road.named(str(path)) == Road((0.0, 15.5), (0.0, -4.0), name=str(path))


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('# only words\n\n', "its header is '', not 'start_m,grade_deg'"),
        ('0,0\n20,10\n', "its header is '0,0', not 'start_m,grade_deg'"),
        ('start_m;grade\n0;0\n', "its header is 'start_m,grade', not"),
        (HEADER, 'it has no numbers below its header'),
        (f'{HEADER}0,0\n20\n', "line 3, '20', must be 2 finite numbers, start_m,grade_deg"),
        (f'{HEADER}0,0\n20,10,5\n', "line 3, '20,10,5', must be 2 finite numbers"),
        (
            f'{HEADER}0,0\n20,1\n10,2\n',
            "line 4, '10,2': start 10.0 m must lie beyond the one before it, 20.0 m",
        ),
        (f'{HEADER}0,{"1" * 200_000}\n', f"line 2, '0,{'1' * 77}…', must be 2 finite numbers"),
    ],
)
def test_file_that_describes_no_road_is_refused_in_one_line(
    tmp_path: Path, text: str, reason: str
) -> None:
    path = tmp_path / 'hill.csv'
    path.write_text(text)
    with pytest.raises(UserError) as refusal:
        Road.named(str(path))
    message = str(refusal.value)
    assert message.startswith(f'road file {str(path)!r} describes no road: {reason}')
    assert '\n' not in message


@pytest.mark.parametrize('name', ['hill.csv', '.', '', 'Lab', 'a\0b', 'x' * 5000])
def test_name_of_no_road_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError) as refusal:
        Road.named(name)
    assert str(refusal.value) == (
        f"road {name!r} is neither 'lab', 'flat' nor a CSV file that can be read"
    )


@properties
@given(s=st.floats(-50.0, 250.0), ds=st.floats(1e-3, 50.0))
def test_way_on_the_map_and_climb_are_never_longer_than_the_way(s: float, ds: float) -> None:
    road = Road.lab()
    way = hypot(
        road.horizontal(s + ds) - road.horizontal(s), road.elevation(s + ds) - road.elevation(s)
    )
    assert way <= ds + 1e-9
    if road.stretch(s) == road.stretch(s + ds):
        assert way == pytest.approx(ds, abs=1e-9)


def force(source: object) -> Signal:
    return signal(source, ROWS['disturbance'], 'force_n')


@pytest.mark.parametrize(
    ('at', 'value'),
    [(-1.0, 1.0), (0.0, 1.0), (2.5, 2.0), (5.0, 7.0), (7.0, 8.0), (9.0, 9.0), (99.0, 9.0)],
)
def test_a_profile_is_straight_between_points_and_level_outside(at: float, value: float) -> None:
    points, values = (0.0, 5.0, 5.0, 9.0), (1.0, 3.0, 7.0, 9.0)
    assert Profile('time_s', points, values)(at, nan) == value
    assert Profile('distance_m', points, values)(nan, at) == value
    assert Profile('time_s', (3.0,), (2.0,))(at, 0.0) == 2.0


def test_a_file_gives_its_values_over_time_or_distance(tmp_path: Path) -> None:
    file = tmp_path / 'gust.csv'
    file.write_text('# a gust\ndistance_m, force_n\n\n10,0\n20,-500\n', encoding='utf-8')
    assert force(file)(0.0, 15.0) == force(str(file))(99.0, 15.0) == -250.0


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('', "its header is '', not 'time_s,force_n' or 'distance_m,force_n'"),
        ('time_s,speed_mps\n0,1\n', "its header is 'time_s,speed_mps', not"),
        ('time_s,force_n\n', 'it has no numbers below its header'),
        ('time_s,force_n\n0\n', "line 2, '0', must be 2 finite numbers, time_s,force_n"),
        ('time_s,force_n\n0,nan\n', "line 2, '0,nan', must be 2 finite numbers"),
        (
            'time_s,force_n\n0,2e6\n',
            "line 2, '0,2e6': disturbance: 2e+06 is not a number from -1e+06 to 1e+06",
        ),
        ('time_s,force_n\n1,0\n0,0\n', "line 3, '0,0': 0 must not be below 1"),
        ('time_s,force_n\n0,0\nnan,0\n', "line 3, 'nan,0', must be 2 finite numbers"),
    ],
)
def test_a_profile_file_with_wrong_contents_is_refused(
    tmp_path: Path, text: str, complaint: str
) -> None:
    file = tmp_path / 'gust.csv'
    file.write_text(text, encoding='utf-8')
    with pytest.raises(UserError, match=r"gust.csv'") as refusal:
        force(file)
    assert complaint in str(refusal.value)
    with pytest.raises(UserError, match=r'disturbance .* is not a readable CSV file'):
        force('nowhere.csv')


def test_a_disturbance_beyond_its_limits_is_refused() -> None:
    assert force(lambda t, x: 2.0 * t + x)(3.0, 4.0) == 10.0
    with pytest.raises(UserError, match=r'disturbance after 3.000 s, at 4.000 m: 1e\+09 is not'):
        force(lambda *_: 1e9)(3.0, 4.0)
