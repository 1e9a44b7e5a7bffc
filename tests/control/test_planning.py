"""Racing line and MPC: inside the limits, the LQR's command, faster, and the same from a file."""

from __future__ import annotations

import sys
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import printed, refused

from barc_sim import MPC, LaneLQR, SpeedMPC, Track, lap, racing_line, speed_profile
from barc_sim.control import mpc
from barc_sim.control.lane import steady_turn
from barc_sim.control.pilots import as_lane_pilot
from barc_sim.control.planning import bending, cost_to_go, lap_time
from barc_sim.control.situation import Navigator
from barc_sim.errors import UserError
from barc_sim.interfaces.records import VehicleState
from barc_sim.vehicle.plant import Actuator

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip('daqp')
LIMITS = 12.0, 3.5, 2.0  #: [m/s], and [m/s²] across and along
L, L_R = 3.0, 1.5
LATE = Actuator(delay=0.1, lag=0.1, rate=1.0)


def free(**gains: float) -> MPC:
    """Return a law without lag, cost of the change and, for small errors, limits."""
    return MPC(**{'lag': 0.0, 'q_change': 0.0, 'rate': 1e3, **gains})


def discrete_lqr(law: MPC) -> np.ndarray:
    """Return the gains by SciPy's Riccati solution of the errors over a step of distance."""
    linalg = pytest.importorskip('scipy.linalg')
    d = law.step
    a, b = np.array([[1.0, d], [0.0, 1.0]]), np.array([[L_R * d + d * d / 2.0], [d]]) / L
    q, r = d * np.diag([law.q_e_y, law.q_e_psi]), np.array([[d]])
    p = linalg.solve_discrete_are(a, b, q, r)
    np.testing.assert_allclose(cost_to_go(law.q_e_y, law.q_e_psi, d, L, L_R), p, rtol=1e-10)
    return np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0]


@pytest.mark.parametrize('curvature', [0.0, 0.05, -0.05])
def test_without_limits_the_command_is_the_lqrs(curvature: float) -> None:
    steer, heading = steady_turn(curvature)
    law = free()
    k = discrete_lqr(law)
    for e_y, e_psi in ((0.1, 0.0), (0.0, 0.1), (-0.2, 0.05)):
        law.reset()
        angle = law.steer_calculate(e_y, heading + e_psi, 6.0, lambda _: curvature)
        assert angle == pytest.approx(steer - k @ [e_y, e_psi], abs=1e-9)


def test_short_steps_lead_to_the_closed_form_of_the_lqr() -> None:
    weights = {'q_e_y': 0.05, 'q_e_psi': 0.3}
    k = LaneLQR(**weights).feedback()
    assert discrete_lqr(free(step=0.001, **weights)) == pytest.approx(k, rel=1e-3)


def test_angle_and_rate_are_within_their_limits() -> None:
    law = MPC()
    commands = [law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0) for _ in range(100)]
    changes = np.diff(commands, prepend=0.0)
    assert np.abs(changes).max() <= 1.0 * 0.02 + 1e-12
    assert min(commands) == pytest.approx(-0.5)
    assert law.infeasible == 0.0


def test_without_a_command_within_all_limits_the_last_one_is_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    law = MPC()
    for _ in range(50):
        law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0)
    monkeypatch.setattr(mpc, 'STEERING_LIMIT', 0.1)
    assert law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0) == -0.1
    assert law.infeasible == 1.0

    monkeypatch.undo()
    law.steer_calculate(0.0, 0.0, 6.0, lambda _: 0.0)
    assert law.infeasible == 0.0


@pytest.mark.parametrize('dynamics', ['kinematic', 'dynamic'])
def test_mpc_drives_l_within_a_quarter_of_a_metre_with_delay_and_lag(dynamics: str) -> None:
    log = lap(MPC(delay=0.1), 'L', speed=6.0, laps=2, servo=LATE, dynamics=dynamics)
    assert np.abs(log.e_y).max() < 0.25
    assert log.best == pytest.approx(29.2, abs=0.5)
    assert not log.own_terms['lane.infeasible'].any()
    assert (log.own_terms['lane.solve_time'] > 0.0).all()


def test_prediction_is_where_the_car_goes() -> None:
    track, law = Track.named('oval'), MPC()
    navigator = Navigator(track)
    pilot = as_lane_pilot(law)
    measured = VehicleState(*track.place(40.0, 0.5, 0.0), 6.0, 0.0, 0.0)
    pilot.command(navigator.situation(0.0, 0.02, measured, lambda _t, _s: 6.0))
    assert pilot.plan is not None

    predicted = navigator.poses(pilot.plan)
    beside = track.frenet(predicted.x, predicted.y, predicted.psi)
    np.testing.assert_allclose(np.diff(beside.s), law.step, atol=1e-9)
    assert beside.e_y[0] == pytest.approx(0.5)
    assert abs(beside.e_y[-1]) < 0.1


def test_speed_is_as_fast_as_the_accelerations_allow() -> None:
    track = Track.named('L')
    log = lap(SpeedMPC(lateral=3.5, longitudinal=2.0, top_speed=12.0), track, laps=2)
    curvature = np.array([track.curvature(s) for s in log.s.tolist()])
    assert np.abs(log.motor).max() <= 2.0 + 1e-6
    assert np.isnan(log.reference).all()  # no speed is held
    assert (log.v_x**2 * np.abs(curvature)).max() < 1.01 * 3.5
    assert log.best == pytest.approx(25.38, abs=0.1)  # as planned over the whole lap
    assert np.abs(log.e_y).max() < 0.25


def test_speed_mpc_brakes_at_its_limit_when_the_car_is_too_fast() -> None:
    law = SpeedMPC()
    law.steer_calculate(0.0, 0.0, 30.0, lambda _: 0.1)
    assert law.acceleration == pytest.approx(-2.0)
    law.steer_calculate(0.0, 0.0, 3.0, lambda _: 0.0)
    assert law.acceleration == pytest.approx(2.0)


@pytest.fixture(scope='module')
def line() -> Track:
    return racing_line('L', margin=1.2)


def test_circle_is_driven_along_its_outer_edge() -> None:
    """∫ κ² dl is 2π/R there."""
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
    assert log.best == pytest.approx(lap_time(line, LIMITS), abs=0.3)
    assert np.abs(log.e_y).max() < 0.25


def test_file_of_the_command_is_the_same_line(line: Track, tmp_path: Path) -> None:
    file, figure = tmp_path / 'line.csv', tmp_path / 'line.png'
    text = printed('raceline', 'L', '--margin', '1.2', '-o', str(file), '--save', str(figure))
    assert f'racing line  {lap_time(line, LIMITS):6.2f} s' in text
    assert figure.read_bytes().startswith(b'\x89PNG')

    read = Track.named(str(file))
    np.testing.assert_allclose(read.lengths, line.lengths, atol=1e-9)
    np.testing.assert_allclose(read.curvatures, line.curvatures, atol=1e-9)
    np.testing.assert_allclose(read.place(20.0), line.place(20.0), atol=1e-9)
    assert read.width == pytest.approx(line.width, abs=1e-6)


def test_a_track_without_a_racing_line_is_refused() -> None:
    with pytest.raises(UserError, match='not closed'):
        racing_line(Track((10.0,), (0.0,)))
    with pytest.raises(UserError, match=r'margin 3.0 must be above 0 and below half.*3 m'):
        racing_line('L', margin=3.0)


@pytest.mark.parametrize('words', [('acc', '--track', 'L', '--lane', 'mpc'), ('raceline', 'L')])
def test_without_daqp_a_sentence_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.setitem(sys.modules, 'daqp', None)
    assert "pip install 'barc_sim[mpc]'" in refused(*words)
