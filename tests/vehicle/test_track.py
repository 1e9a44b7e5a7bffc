"""Tracks: their shapes, the way to the map and back, and the files that describe them."""

from __future__ import annotations

from math import asin, cos, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.errors import UserError
from barc_sim.vehicle.track import TRACKS, Frenet, Pose, Track

if TYPE_CHECKING:
    from pathlib import Path

LAPS = 3
N = 10_000


def random_poses(track: Track) -> tuple[Frenet, Any]:
    """Return poses over some laps, from edge to edge, and places nearby."""
    random = np.random.default_rng(0)
    s = random.uniform(-LAPS * track.length, LAPS * track.length, N)
    e_y = 0.5 * track.width * random.uniform(-1.0, 1.0, N)
    e_psi: Any = random.uniform(-1.5, 1.5, N)
    return Frenet(s, e_y, e_psi, 0.0), s + random.uniform(-3.0, 3.0, N)


@pytest.mark.parametrize(
    ('name', 'length'),
    [('L', 174.556), ('oval', 225.664), ('circle', 125.664), ('figure-eight', 268.496)],
)
def test_tracks_with_a_name_are_closed(name: str, length: float) -> None:
    track = Track.named(name)
    assert track.is_closed
    assert track.length == pytest.approx(length, abs=1e-3)
    assert track.width == 6.0
    end, begin = track.place(track.length * (1.0 - 1e-15)), track.place(0.0)
    assert end[:2] == pytest.approx(begin[:2], abs=1e-9)


@pytest.mark.parametrize('name', TRACKS)
def test_place_and_frenet_are_inverse_also_where_the_track_meets_itself(name: str) -> None:
    track = Track.named(name)
    true, near = random_poses(track)
    poses = track.place(*true[:3])
    many = track.frenet(*poses, near)
    rows = zip(*(one_by_one.tolist() for one_by_one in (*poses, near)), strict=True)  # type: ignore[attr-defined]
    one_by_one = np.array([track.frenet(x, y, psi, at) for x, y, psi, at in rows]).T
    for frenet_places in (many, one_by_one):
        for column, expected in zip(frenet_places[:3], true[:3], strict=True):
            assert np.abs(column - np.asarray(expected)).max() < 1e-12
    assert (one_by_one[3] == many.curvature).all()

    places = np.array([track.place(s, 1.0, 0.2) for s in near[:50].tolist()])
    assert np.abs(places - np.array(track.place(near[:50], 1.0, 0.2)).T).max() < 1e-12

    across = [track.place(30.0, e_y) for e_y in (-1.0, 2.0)]
    assert np.abs(np.array(track.place(30.0, np.array([-1.0, 2.0]))).T - across).max() < 1e-12


@pytest.mark.parametrize('name', ['L', 'oval', 'circle'])
def test_without_a_place_nearby_the_nearest_part_counts(name: str) -> None:
    track = Track.named(name)
    true, _ = random_poses(track)
    poses = track.place(*true[:3])
    nearest = track.frenet(*poses)
    at_most = np.minimum(np.abs(true.e_y), 0.5 * track.width)
    assert (np.abs(nearest.e_y) <= at_most + 1e-9).all()

    rows = zip(*(each[:200].tolist() for each in poses), strict=True)  # type: ignore[index]
    for row, s in zip(rows, nearest.s.tolist(), strict=False):  # type: ignore[attr-defined]
        assert track.frenet(*row).s == pytest.approx(s, abs=1e-9)


def test_an_arc_is_a_circle_and_s_grows_over_the_finish_line() -> None:
    track = Track.named('circle')
    near = 0.0
    for k in range(400):
        angle = 0.02 * k
        place = track.frenet(18.0 * sin(angle), 20.0 - 18.0 * cos(angle), angle, near)
        assert place == pytest.approx((20.0 * angle, 2.0, 0.0, 0.05), abs=1e-9)
        near = place.s
    assert near > track.length


def test_an_open_track_continues_beyond_its_ends() -> None:
    track = Track((10.0, 5.0 * pi), (0.0, 0.1), start=Pose(1.0, 2.0, 0.5))
    assert not track.is_closed

    for s in (-4.0, 3.0, 12.0, 30.0):
        pose = track.place(s, 1.0, asin(0.1))
        assert track.frenet(*pose, s) == pytest.approx((s, 1.0, asin(0.1), track.curvature(s)))
        many = track.frenet(*(np.array([each]) for each in pose), np.array([s]))
        assert [each.item() for each in many] == pytest.approx(
            [s, 1.0, asin(0.1), track.curvature(s)]
        )


def test_a_file_has_lengths_and_radii(tmp_path: Path) -> None:
    file = tmp_path / 'oval.csv'
    rows = [f'{length!r},{radius!r}' for length, radius in TRACKS['oval']]
    file.write_text('\n'.join(['length_m,radius_m', '# turns left', *rows]))
    track, oval = Track.named(str(file)), Track.named('oval')
    assert (track.lengths, track.curvatures) == (oval.lengths, oval.curvatures)


def test_arcs_are_fitted_to_a_centre_line(tmp_path: Path) -> None:
    t = np.linspace(0.0, 2.0 * pi, 400, endpoint=False)
    x, y = 300.0 * np.cos(t) + 40.0 * np.cos(3.0 * t), 200.0 * np.sin(t) + 25.0 * np.sin(2.0 * t)
    file, header = tmp_path / 'ring.csv', 'x_m,y_m,w_tr_right_m,w_tr_left_m'
    widths = np.full(400, 4.0), np.linspace(6.0, 5.0, 400)
    np.savetxt(file, np.column_stack([x, y, *widths]), delimiter=',', header=header)
    track = Track.named(str(file))
    assert track.is_closed
    assert (track.width, len(track.lengths) < 100) == (8.0, True)

    places = track.frenet(x, y, np.zeros(400))
    assert track.deviation == pytest.approx(np.abs(places.e_y).max(), abs=1e-6)
    assert track.deviation < 0.051

    speeds = np.hypot(np.diff(x, append=x[0]), np.diff(y, append=y[0]))
    assert track.length == pytest.approx(speeds.sum(), rel=1e-3)


def test_a_circle_of_points_is_fitted_by_few_arcs(tmp_path: Path) -> None:
    t = np.linspace(0.0, 2.0 * pi, 100, endpoint=False)
    file, header = tmp_path / 'circle.csv', 'x_m,y_m,w_tr_right_m,w_tr_left_m'
    columns = 50.0 * np.cos(t), 50.0 * np.sin(t), np.full(100, 3.0), np.full(100, 3.0)
    np.savetxt(file, np.column_stack(columns), delimiter=',', header=header)
    track = Track.named(str(file))
    assert (len(track.lengths), track.is_closed) == (4, True)
    assert track.curvatures == pytest.approx([0.02] * 4)


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        (
            'length_m,radius_m\n10,0\n-5,0\n',
            'length -5.0 m and curvature 0.0 1/m: expected a length',
        ),
        ('length_m,radius_m\n10,1\n', 'an arc of 10 m with radius 1 m is more than a whole turn'),
        (
            'length_m,radius_m\n5,2\n',
            "line 2, '5,2': radius 2 m must be above half of the width, 6 m",
        ),
        ('length_m,radius_m\n5,x\n', "line 2, '5,x', must be 2 finite numbers, length_m,radius_m"),
        ('start_m,grade_deg\n5,2\n', "its header is 'start_m,grade_deg', not 'length_m,radius_m'"),
        ('x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n1,0,3,3\n', '2 points, not 3 to 10000'),
        (
            'x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n0,0,3,3\n1,0,3,3\n',
            "line 2, '0,0,3,3': this point is the same",
        ),
        (
            'x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n9,0,3,3\n5,0,3,3\n',
            "line 2, '0,0,3,3': .*the line turns back",
        ),
        (
            'x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3\n1,0,3\n0,1,3\n',
            "line 2, '0,0,3', must be 4 finite numbers, x_m,y_m",
        ),
        (
            'x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n9,0,3,nan\n0,9,3,3\n',
            "line 3, '9,0,3,nan', must be 4 finite numbers",
        ),
    ],
)
def test_a_file_that_describes_no_track_is_refused(
    tmp_path: Path, text: str, complaint: str
) -> None:
    file = tmp_path / 'track.csv'
    file.write_text(text)
    with pytest.raises(UserError, match=f"track.csv' describes no track: .*{complaint}"):
        Track.named(str(file))


CENTRE_LINE = 'x_m,y_m,w_tr_right_m,w_tr_left_m'


def centre_line(file: Path, s: np.ndarray, track: Track, half: float = 3.0) -> Track:
    """Return the track of a file as F1TENTH writes it, with points of `track` at `s` [m]."""
    x, y, _ = track.place(s)
    rows = [f'{a!r}, {b!r}, {half}, {half}' for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    file.write_text('\n'.join([f'# {CENTRE_LINE.replace(",", ", ")}', *rows]), encoding='utf-8')
    return Track.named(str(file))


def test_a_centre_line_of_f1tenth_is_read(tmp_path: Path) -> None:
    """Its header follows a #, with spaces, after which there can be more comments."""
    oval = Track.named('oval')
    track = centre_line(tmp_path / 'oval.csv', np.arange(0.0, oval.length - 0.5, 0.7), oval)
    assert track.length == pytest.approx(oval.length, rel=1e-3)

    lines = (tmp_path / 'oval.csv').read_text().splitlines()
    lines[0:1] = ['# 603fd39', '', f'#{CENTRE_LINE.replace(",", "; ")}', '# in metres']
    again = tmp_path / 'again.csv'
    again.write_text('\r'.join(line.replace(', ', '; ') for line in lines))
    assert Track.named(str(again)).lengths == track.lengths


@pytest.mark.parametrize('name', ['oval', 'L', 'figure-eight'])
@pytest.mark.parametrize('laps', [0.999, 1.0, 1.05, 2.4])
def test_points_beyond_a_lap_are_left_out(tmp_path: Path, name: str, laps: float) -> None:
    """Also where the second lap is not quite where the first was; a crossing is no end."""
    course = Track.named(name)
    s = np.arange(0.0, laps * course.length, 0.9)
    track = centre_line(tmp_path / 'line.csv', s, course)
    assert track.length == pytest.approx(course.length, rel=5e-3)


def test_a_sharp_bend_makes_the_track_narrower(tmp_path: Path) -> None:
    """As in the tracks of F1TENTH, whose edges are 1.1 m away everywhere."""
    sharp = Track((20.0, 2.0 * pi) * 2, (0.0, 0.5) * 2, width=1.0)
    track = centre_line(tmp_path / 'sharp.csv', np.arange(0.0, sharp.length, 0.1), sharp, half=2.5)
    assert 3.0 < track.width < 4.0
    assert max(map(abs, track.curvatures)) * track.width < 2.0


def test_a_bend_that_is_too_sharp_is_named(tmp_path: Path) -> None:
    file = tmp_path / 'kink.csv'
    points = [(0, 0), (20, 0), (40, 0), (40.1, 0.1), (40, 0.2), (20, 20), (0, 20)]
    file.write_text('\n'.join([f'# {CENTRE_LINE}', *(f'{x},{y},3,3' for x, y in points)]))
    with pytest.raises(
        UserError, match=r"line [456], '4.*: the line bends near here with a radius"
    ):
        Track.named(str(file))


def test_a_wrong_description_of_a_track_is_refused() -> None:
    with pytest.raises(UserError, match="track 'M' is neither 'L', 'oval', 'circle', 'figure-eig"):
        Track.of('M')
    with pytest.raises(UserError, match='1 lengths and 2 curvatures: expected the same'):
        Track((1.0,), (0.0, 0.1))
    with pytest.raises(UserError, match=r'width 0.0 must be a number of metres'):
        Track((1.0,), (0.0,), width=0.0)
