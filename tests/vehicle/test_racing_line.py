"""The line of least curvature: inside the edges, straighter, faster, and the same from its file."""

from __future__ import annotations

import sys
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import printed, refused

from barc_sim import LaneLQR, Track, lap, racing_line, speed_profile
from barc_sim.errors import UserError
from barc_sim.vehicle.racing_line import lap_time

if TYPE_CHECKING:
    from pathlib import Path

LIMITS = 12.0, 3.5, 2.0  #: [m/s], and [m/s²] across and along


@pytest.fixture(scope='module')
def line() -> Track:
    pytest.importorskip('daqp')
    return racing_line('L', margin=1.2)


def bending(track: Track) -> float:
    """Return ∫ κ² dl."""
    return sum(k * k * length for k, length in zip(track.curvatures, track.lengths, strict=True))


def test_circle_is_driven_along_its_outer_edge() -> None:
    """∫ κ² dl is 2π/R there."""
    pytest.importorskip('daqp')
    line = racing_line('circle', margin=1.0)
    assert line.length == pytest.approx(2.0 * pi * 22.0, rel=1e-4)
    np.testing.assert_allclose(line.curvatures, 1.0 / 22.0, rtol=1e-3)


def test_bends_less_than_the_centre_line_and_keeps_the_margin(line: Track) -> None:
    track = Track.named('L')
    s = np.linspace(0.0, line.length, 2000)
    e_y = track.frenet(*line.place(s)).e_y
    assert np.abs(e_y).max() < 1.8 + 1e-3
    assert line.is_closed
    assert line.width == pytest.approx(2.4)
    assert bending(line) < 0.67 * bending(track)


def test_no_line_nearby_bends_less(line: Track) -> None:
    """As found, the line is at a minimum: shares of the centre line's offsets bend more."""
    track = Track.named('L')
    x, y, psi = line.place(np.array(line.starts[:-1:2]))
    s, e_y, *_ = track.frenet(x, y, psi)
    for share in (0.9, 0.99):
        there = track.place(s, share * e_y)
        assert bending(Track.through(there.x, there.y)) > bending(line)


@pytest.mark.parametrize('dynamics', ['kinematic', 'dynamic'])
def test_l_is_driven_in_at_most_21_5_s(line: Track, dynamics: str) -> None:
    """The centre line takes 25.1 s and more."""
    speed = speed_profile(line, *LIMITS)
    log = lap(LaneLQR(preview=0.1), line, speed=speed, laps=2, dynamics=dynamics)
    assert log.best < 21.5
    assert log.best == pytest.approx(lap_time(line, speed), abs=0.3)
    assert np.abs(log.e_y).max() < 0.25


def test_lap_time_of_a_constant_speed_is_the_length_over_it() -> None:
    track = Track.named('oval')
    assert lap_time(track, lambda *_: 8.0) == pytest.approx(track.length / 8.0)


def test_file_of_the_command_is_the_same_line(line: Track, tmp_path: Path) -> None:
    file, figure = tmp_path / 'line.csv', tmp_path / 'line.png'
    text = printed('raceline', 'L', '--margin', '1.2', '-o', str(file), '--save', str(figure))
    assert f'racing line  {lap_time(line, speed_profile(line, *LIMITS)):6.2f} s' in text
    assert figure.read_bytes().startswith(b'\x89PNG')
    read = Track.named(str(file))
    np.testing.assert_allclose(read.lengths, line.lengths, atol=1e-9)
    np.testing.assert_allclose(read.curvatures, line.curvatures, atol=1e-9)
    np.testing.assert_allclose(read.place(20.0), line.place(20.0), atol=1e-9)
    assert read.width == pytest.approx(line.width, abs=1e-6)


def test_what_has_no_racing_line_is_refused() -> None:
    with pytest.raises(UserError, match='not closed'):
        racing_line(Track((10.0,), (0.0,)))
    with pytest.raises(UserError, match=r'margin 3.0 must be above 0 and below half.*3 m'):
        racing_line('L', margin=3.0)


def test_without_daqp_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'daqp', None)
    assert "pip install 'barc_sim[mpc]'" in refused('raceline', 'L')
