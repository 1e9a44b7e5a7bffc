"""The MPC of the lane, and of lane and speed: the LQR's command, limits, and whole laps."""

from __future__ import annotations

import sys
from math import inf

import numpy as np
import pytest
from command_line import refused

from barc_sim import MPC, LaneLQR, SpeedMPC, Track, lap
from barc_sim.control.lane import LaneKeeping, steady_turn
from barc_sim.control.mpc import riccati
from barc_sim.errors import UserError
from barc_sim.vehicle.plant import Actuator

daqp = pytest.importorskip('daqp')
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
    np.testing.assert_allclose(riccati(a, b, q, d), p, rtol=1e-10)
    return np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0]


@pytest.mark.parametrize('curvature', [0.0, 0.05, -0.05])
def test_without_limits_the_command_is_the_lqrs(curvature: float) -> None:
    steer, heading = steady_turn(curvature)
    law = free()
    k = discrete_lqr(law)
    for e_y, e_psi in ((0.1, 0.0), (0.0, 0.1), (-0.2, 0.05)):
        law.reset()
        found = law.steer_calculate(e_y, heading + e_psi, 6.0, lambda _: curvature)
        assert found == pytest.approx(steer - k @ [e_y, e_psi], abs=1e-9)


def test_short_steps_lead_to_the_closed_form_of_the_lqr() -> None:
    weights = {'q_e_y': 0.05, 'q_e_psi': 0.3}
    k = LaneLQR(**weights).feedback()
    assert discrete_lqr(free(step=0.001, **weights)) == pytest.approx(k, rel=1e-3)


def test_angle_and_rate_are_within_their_limits() -> None:
    law = MPC(output_max=0.3)
    commands = [law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0) for _ in range(100)]
    changes = np.diff(commands, prepend=0.0)
    assert np.abs(changes).max() <= 1.0 * 0.02 + 1e-12
    assert min(commands) == pytest.approx(-0.3)
    assert law.saturated
    assert law.infeasible == 0.0


def test_where_no_command_is_within_all_limits_the_last_one_is_cut() -> None:
    law = MPC()
    for _ in range(50):
        law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0)
    law.output_max = 0.1
    assert law.steer_calculate(3.0, 0.5, 6.0, lambda _: 0.0) == -0.1
    assert law.infeasible == 1.0
    law.output_max = 0.5
    law.steer_calculate(0.0, 0.0, 6.0, lambda _: 0.0)
    assert law.infeasible == 0.0


@pytest.mark.parametrize('dynamics', ['kinematic', 'dynamic'])
def test_l_is_driven_within_a_quarter_of_a_metre_in_spite_of_delay_and_lag(dynamics: str) -> None:
    log = lap(MPC(delay=0.1), 'L', speed=6.0, laps=2, servo=LATE, dynamics=dynamics)
    assert np.abs(log.e_y).max() < 0.25
    assert log.best == pytest.approx(29.2, abs=0.5)
    assert not log.own_terms['lane.infeasible'].any()
    assert (log.own_terms['lane.solve_time'] > 0.0).all()


def test_delay_that_the_law_does_not_know_costs_more() -> None:
    with_delay, without = (
        np.abs(lap(MPC(delay=delay), 'L', laps=1, servo=LATE).e_y).max() for delay in (0.1, 0.0)
    )
    assert with_delay < 0.6 * without


def test_prediction_is_where_the_car_goes() -> None:
    track, law = Track.named('oval'), MPC()
    keeping = LaneKeeping(law, track)
    keeping.steer(*track.place(40.0, 0.5, 0.0), 6.0)
    predicted = keeping.predicted()
    beside = track.frenet(predicted.x, predicted.y, predicted.psi)
    np.testing.assert_allclose(np.diff(beside.s), law.step, atol=1e-9)
    assert beside.e_y[0] == pytest.approx(0.5)
    assert abs(beside.e_y[-1]) < 0.1


def test_speed_is_as_fast_as_the_accelerations_allow() -> None:
    track = Track.named('L')
    log = lap(SpeedMPC(lateral=3.5, longitudinal=2.0, top_speed=12.0), track, laps=2)
    curvature = np.array([track.curvature(s) for s in log.s.tolist()])
    assert np.abs(log.motor).max() <= 2.0 + 1e-6
    assert (log.v_x**2 * np.abs(curvature)).max() < 1.01 * 3.5
    assert log.best == pytest.approx(25.4, abs=0.2)  # 25.38 s planned over the whole lap
    assert np.abs(log.e_y).max() < 0.25


def test_one_that_is_too_fast_brakes_as_hard_as_it_can() -> None:
    law = SpeedMPC()
    law.steer_calculate(0.0, 0.0, 30.0, lambda _: 0.1)
    assert law.acceleration == pytest.approx(-2.0)
    law.steer_calculate(0.0, 0.0, 3.0, lambda _: 0.0)
    assert law.acceleration == pytest.approx(2.0)


def test_gains_are_within_their_limits() -> None:
    with pytest.raises(UserError, match='step'):
        MPC(step=0.0)
    with pytest.raises(UserError, match='lag'):
        MPC(lag=inf)


def test_without_daqp_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'daqp', None)
    assert "pip install 'barc_sim[mpc]'" in refused('acc', '--track', 'L', '--lane', 'mpc')
