"""`lap`: laps of a track, and their log."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, nan, radians, sin
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.lane import STEERING_LIMIT, LaneLQR
from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.simulation.closed_loop import lap, simulate
from barc_sim.simulation.log import Log, TrackLog
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.bike_model import BicycleState
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.control.lane import Curvature


@pytest.fixture(scope='module')
def three() -> TrackLog:
    return lap(dynamics='dynamic')


def test_the_lqr_keeps_the_lane_of_the_l_at_6_m_s(three: TrackLog) -> None:
    assert np.abs(three.e_y).max() < 0.25
    assert three.best == pytest.approx(29.2, abs=0.5)
    assert summary(three).max_error_after_run_up < 0.05


@pytest.mark.parametrize('integrator', ['euler', 'rk4'])
def test_a_preview_makes_up_for_a_delay(integrator: str) -> None:
    late: dict[str, Any] = {'dynamics': 'dynamic', 'laps': 2, 'integrator': integrator}
    late['servo'] = Actuator(delay=0.1, lag=0.1, rate=1.0)
    assert np.abs(lap(LaneLQR(preview=0.1), **late).e_y).max() < 0.25
    assert np.abs(lap(LaneLQR(), **late).e_y).max() > 0.4
    assert lap(laps=1, delay=0.1) == lap(laps=1, delay=0.1, servo=late['servo'])


def test_laps_are_flying_and_split_where_s_passes_the_line(three: TrackLog) -> None:
    length = Track.named('L').length
    first, second, third = three.lap_times
    assert first > second == pytest.approx(third, abs=1e-3)
    assert three.best == min(second, third)
    assert [*np.unique(three.lap)] == [0.0, 1.0, 2.0, 3.0]
    assert (three.lap == np.floor(three.s / length)).all()
    assert three.s[-1] >= 3.0 * length > three.s[-2]

    for k in (1, 2, 3):
        (i,) = np.flatnonzero(np.diff(three.lap) == 1.0)[k - 1 : k] + 1
        over = three.s[i] - k * length
        assert three.lap_time[i] == pytest.approx(0.02 * over / (three.s[i] - three.s[i - 1]))
    assert first == pytest.approx(np.interp(length, three.s, three.t), abs=1e-9)


def test_the_log_is_a_log_with_the_place_on_the_track(three: TrackLog) -> None:
    terms = {f'steer_{name}' for name in LaneLQR.terms}
    assert three.columns().keys() - Log.declared.keys() == terms | {
        *('s', 'e_y', 'e_psi', 'curvature', 'width', 'lap', 'lap_time', 'steer_saturated')
    }

    steering = sum(three.columns()[name] for name in sorted(terms))
    assert np.abs(steering - three.servo).max() < 1e-12
    assert not three.steer_saturated.any()

    half = three.map(lambda column: column[::2])
    assert (half.distance == three.s[::2]).all()
    assert (half.across == three.e_y[::2]).all()

    places = Track.named('L').frenet(three.x, three.y, three.psi, three.s)
    assert np.abs(places.s - three.s).max() < 1e-9
    assert np.abs(places.e_psi - three.e_psi).max() < 1e-9
    assert (places.curvature == three.curvature).all()
    assert three.to_frame().attrs['units']['curvature'] == '1/m'


def test_noise_reaches_the_law_and_the_log_has_the_true_place() -> None:
    log = lap(track='oval', laps=1, noise=0.1, seed=3)
    again, other = (lap(track='oval', laps=1, noise=0.1, seed=seed) for seed in (3, 4))
    assert log == again != other
    true = Track.named('oval').frenet(log.x, log.y, log.psi, log.s)
    assert np.abs(true.e_y - log.e_y).max() < 1e-9  # of the speed alone
    across = lap(track='oval', laps=1, noise=NoiseLevels(ey=0.1))
    assert np.corrcoef(np.diff(across.servo), np.diff(across.e_ey))[0, 1] < -0.9


def test_a_users_law_is_fresh_in_each_run() -> None:
    class Integral:
        def __init__(self) -> None:
            self.sum = 0.0

        def steer_calculate(
            self, e_y: float, e_psi: float, _: float, curvature: Curvature
        ) -> float:
            self.sum += 0.001 * e_y
            return 3.0 * curvature(0.0) - 0.2 * e_y - 0.6 * e_psi - self.sum

    law = Integral()
    log = lap(law, 'oval', laps=1)
    assert log == lap(law, 'oval', laps=1)
    assert law.sum == 0.0
    assert np.isnan(log.steer_of_e_y).all()  # it has no terms


def test_a_laws_own_terms_are_in_the_log() -> None:
    class Counting(LaneLQR):
        terms: Mapping[str, str] = {**LaneLQR.terms, 'calls': 'how many'}
        calls = 0

        def steer_calculate(self, *arguments: Any) -> float:  # noqa: ANN401
            self.calls += 1
            return super().steer_calculate(*arguments)

    narrow = replace(Track.named('oval'), width=4.0)
    log = lap(Counting(), narrow, laps=1)
    assert log.own_terms['lane.calls'].tolist() == [*range(1, len(log) + 1)]
    assert set(log.width) == {4.0}
    assert [*log.terms] == [*PID.terms]
    assert (log.steer_of_e_y == lap(LaneLQR(), narrow, laps=1).steer_of_e_y).all()
    assert log.to_frame().attrs['units']['lane.calls'] == ''


def test_a_law_in_degrees_is_cut_at_the_limit_of_the_steering() -> None:
    class Degrees(LaneLQR):
        def steer_calculate(self, *arguments: Any) -> float:  # noqa: ANN401
            return degrees(super().steer_calculate(*arguments))

    class Bare:  # as a student writes it: without a limit of its own
        def steer_calculate(self, *arguments: Any) -> float:  # noqa: ANN401
            return Degrees().steer_calculate(*arguments)

    for law in (Degrees(), Bare()):
        log = lap(law, laps=1)
        assert np.abs(log.servo).max() == STEERING_LIMIT
        assert log.steer_saturated.mean() > 0.5
        assert (log.steer_saturated == (np.abs(log.servo) == STEERING_LIMIT)).all()


def test_a_car_beyond_the_edge_ends_the_run() -> None:
    class Straight:
        def steer_calculate(self, *_: object) -> float:
            return 0.0

    log = lap(Straight())  # type: ignore[arg-type]
    assert abs(log.e_y[-1]) > 3.0 > abs(log.e_y[-2])
    assert (len(log.lap_times), log.best) == (0, np.inf)


def test_a_road_on_a_track_repeats_in_each_lap() -> None:
    road = Road((0.0, 60.0, 100.0), (0.0, 4.0, 0.0))
    log = lap(track='oval', laps=2, road=road)
    on_hill = (log.s % Track.named('oval').length >= 60.0) & (
        log.s % Track.named('oval').length < 100.0
    )
    assert (log.theta_deg == np.where(on_hill, 4.0, 0.0)).all()
    assert log.gravity[on_hill] == pytest.approx(-19600.0 * sin(radians(4.0)))
    assert log.motor[on_hill].mean() > 0.5


def test_a_track_is_flat_unless_a_road_is_given() -> None:
    oval = Track.named('oval')
    log = simulate(track=oval, lane=LaneLQR(), speed_reference=6.0, distance=oval.length)
    assert log == lap(track=oval, laps=1)


def test_a_placed_car_begins_a_lap_where_it_is_nearest() -> None:
    plant = Plant(track=Track.named('circle'))
    plant.place(BicycleState(20.0, 20.0, 1.5, 5.0))
    assert plant.on_track
    assert plant.distance == pytest.approx(31.4159, abs=1e-3)
    assert (plant.on_track.lap, plant.on_track.lap_time) == (0, 0.0)
    assert not plant.has_fast_path


def test_a_car_that_rolls_back_over_the_line_stays_in_its_lap() -> None:
    plant = Plant(track=Track.named('oval'))
    plant.place(BicycleState(*Track.named('oval').place(225.6), v=8.0))
    laps = []
    for k in range(60):
        plant.advance(Command(-20.0 if k > 4 else 0.0))
        assert plant.on_track
        laps.append((plant.on_track.lap, plant.distance > 225.67))
    assert (laps[0], laps[-1]) == ((1, True), (1, False))


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'track': 'M'}, "track 'M' is neither"),
        ({'track': Track((10.0,), (0.0,)), 'laps': 2}, "'track' is not closed: expected laps 1"),
        ({'laps': 0}, 'laps: 0 is not a whole number from 1'),
        ({'speed': nan}, 'reference: nan is not a number'),
        ({'lane': object()}, 'must be an object with a method steer_calculate'),
        ({'lane': LaneLQR}, 'must be an object with a method steer_calculate'),
        ({'e_y': nan}, 'e_y: nan is not a number'),
        ({'servo': 0.1}, r'servo 0.1 must be of type Actuator, such as Actuator\(delay=0.0\)'),
        ({'ts': 0.0}, 'ts: 0 is not a number'),
    ],
)
def test_an_argument_that_makes_no_lap_is_refused(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        lap(**options)


@pytest.mark.parametrize('options', [{'lane': LaneLQR()}, {'e_y': 1.0}])
def test_steering_needs_a_track(options: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="needs a track: give one, such as track='L'"):
        simulate(**options)
