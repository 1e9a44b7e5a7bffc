"""Steering laws and the speed profile: against closed forms, on circles and whole laps."""

from __future__ import annotations

import pickle
from math import asin, atan2, cos, hypot, pi, sin, sqrt
from typing import ClassVar

import numpy as np
import pytest

from barc_sim.control.lane import (
    LaneLaw,
    LaneLQR,
    PurePursuit,
    Stanley,
    speed_profile,
    steady_turn,
)
from barc_sim.control.pilots import LaneKeeping, as_lane_pilot, as_pilot
from barc_sim.control.situation import Navigator, Situation
from barc_sim.control.speed import PID, Gain
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.simulation.closed_loop import lap
from barc_sim.vehicle.bike_model import BicycleState, Vehicle
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.track import Track

L, L_R = 3.0, 1.5
LAWS = (LaneLQR, Stanley, PurePursuit)
FREE = Vehicle(air_drag_coeff=0.0, friction=0.0)


def on_circle(radius: float, v: float, e_psi: float, integrator: str, steer: float) -> Plant:
    """Return a car that has driven 480 m with one steering angle, from the centre line on."""
    track = Track((2.0 * pi * radius,), (1.0 / radius,))
    plant = Plant(track=track, vehicle=FREE, integrator=integrator)
    plant.place(BicycleState(*track.place(0.0, 0.0, e_psi), v=v))
    for _ in range(round(480.0 / v / plant.ts)):
        plant.advance(Command(0.0, steer))
        assert plant.on_track
        assert abs(plant.on_track.e_y) < 1e-8
        assert abs(plant.on_track.e_psi - e_psi) < 1e-8
    return plant


@pytest.mark.parametrize('radius', [8.0, 20.0])
def test_steady_turn_keeps_the_car_on_the_circle(radius: float) -> None:
    steer, e_psi = steady_turn(1.0 / radius)
    assert steer == pytest.approx(atan2(L, sqrt(radius**2 - L_R**2)))
    assert e_psi == pytest.approx(-asin(L_R / radius))
    assert steady_turn(-1.0 / radius) == (-steer, -e_psi)
    plant = on_circle(radius, 8.0, e_psi, 'rk4', steer)
    assert plant.distance == pytest.approx(480.0, abs=1e-6)
    assert plant.observe().on_track == plant.on_track


def test_forward_euler_drives_a_polygon_of_its_own_radius() -> None:
    v, ts = 8.0, 0.02
    steer, e_psi = steady_turn(1.0 / 20.0)
    turn = v * ts * sin(-e_psi) / L_R
    radius = v * ts / (2.0 * sin(0.5 * turn))
    on_circle(radius, v, 0.5 * turn + e_psi, 'euler', steer)
    assert radius == pytest.approx(20.0000533, abs=1e-6)


@pytest.mark.parametrize(('q_e_y', 'q_e_psi'), [(0.05, 0.2), (3.0, 0.0), (1e-4, 20.0)])
@pytest.mark.parametrize('speed', [1.0, 13.0])
def test_gains_are_those_of_the_riccati_equation_at_every_speed(
    q_e_y: float, q_e_psi: float, speed: float
) -> None:
    linalg = pytest.importorskip('scipy.linalg')
    a = speed * np.array([[0.0, 1.0], [0.0, 0.0]])
    b = speed * np.array([[L_R / L], [1.0 / L]])
    cost = linalg.solve_continuous_are(a, b, np.diag([q_e_y, q_e_psi]), np.eye(1))
    law = LaneLQR(q_e_y=q_e_y, q_e_psi=q_e_psi)
    assert law.feedback() == pytest.approx(tuple((b.T @ cost)[0]), rel=1e-12)


def test_terms_sum_to_the_angle() -> None:
    law = LaneLQR(preview=0.5)
    k1, k2 = law.feedback()
    steer = law.steer_calculate(0.3, -0.1, 6.0, lambda d: 0.05 if d == 3.0 else 0.0)
    assert law.feedforward == steady_turn(0.05)[0]
    assert (law.of_e_y, law.of_e_psi) == pytest.approx((-k1 * 0.3, k2 * 0.1))
    assert steer == law.feedforward + law.of_e_y + law.of_e_psi
    law.reset()
    assert (law.feedforward, law.of_e_y, law.of_e_psi) == (0.0, 0.0, 0.0)


def test_pursuit_steers_the_circle_through_its_point() -> None:
    law = PurePursuit(look_ahead=4.0, look_ahead_time=0.5)
    for e_psi in (0.0, 0.3):
        steer = law.steer_calculate(1.0, e_psi, 2.0, lambda _: 0.0)
        # The point from the rear axle, and its direction from the car's axis.
        x, y = 5.0 + L_R * cos(e_psi), -1.0 + L_R * sin(e_psi)
        direction = atan2(y, x) - e_psi
        assert steer == pytest.approx(atan2(2.0 * L * sin(direction), hypot(x, y)))


def test_stanley_aims_at_the_front_axles_point() -> None:
    law = Stanley(k=2.0, v_soft=1.0)
    assert law.steer_calculate(0.0, 0.2, 5.0, lambda _: 0.0) == pytest.approx(
        -0.2 - atan2(2.0 * 1.5 * sin(0.2), 6.0)
    )
    assert law.steer_calculate(0.0, 0.0, 5.0, lambda _: 0.0) == 0.0


def test_a_law_without_feedforward_keeps_its_error_on_a_circle() -> None:
    class Feedback(LaneLQR):
        def steer_calculate(self, e_y: float, e_psi: float, *_: object) -> float:
            k1, k2 = self.feedback()
            return -k1 * e_y - k2 * e_psi

    log = lap(Feedback(), 'circle', integrator='rk4')
    k1, k2 = LaneLQR().feedback()
    steer, e_psi = steady_turn(1.0 / (20.0 - log.e_y[-1]))
    assert log.e_y[-1] == pytest.approx(-(steer + k2 * e_psi) / k1, abs=1e-6)
    assert log.e_y[-1] < -0.3


@pytest.mark.parametrize('kind', LAWS)
def test_each_law_keeps_to_the_track_and_is_the_same_to_either_side(kind: type[LaneLaw]) -> None:
    track = Track.named('figure-eight')
    mirror = Track(track.lengths, tuple(-each for each in track.curvatures))
    log, mirrored = (lap(kind(), each, laps=1, e_y=0.5) for each in (track, mirror))
    assert np.abs(log.e_y[200:]).max() < 0.3
    flipped = lap(kind(), mirror, laps=1, e_y=-0.5)
    assert (log.e_y == -flipped.e_y).all()
    assert (log.servo == -flipped.servo).all()
    assert not (log.e_y == -mirrored.e_y).all()


def test_from_1_m_beside_the_lane_the_lqr_returns_within_30_m() -> None:
    log = lap(track='L', laps=1, e_y=1.0, servo=Actuator())
    assert log.e_y[0] == pytest.approx(1.0)
    beyond = log.e_y[:300]
    assert beyond.min() > -0.2
    assert np.abs(log.e_y[(log.s > 20.0) & (log.s < 22.0)]).max() < 0.1


def test_a_profile_is_as_fast_as_its_limits_allow() -> None:
    oval = Track.named('oval')
    profile = speed_profile(oval, maximum=12.0, across=3.2, along=2.0)
    s = (np.arange(100_000) + 0.5) * oval.length / 100_000
    speed = np.array([profile(0.0, each) for each in s.tolist()])
    corner = sqrt(3.2 * 20.0)
    level = 50.0 - 2.0 * (12.0**2 - corner**2) / (2.0 * 2.0)  # [m] of each straight at 12 m/s
    time = 2.0 * (2.0 * (12.0 - corner) / 2.0 + level / 12.0) + 2.0 * pi * 20.0 / corner
    assert np.sum(oval.length / len(s) / speed) == pytest.approx(time, rel=1e-6)

    log = lap(track=oval, speed=profile)
    assert log.best == pytest.approx(time, abs=0.05)
    assert np.abs(log.speed_error[log.t > 8.0]).max() < 0.1


def test_a_profile_does_not_depend_on_where_a_lap_begins() -> None:
    oval = Track.named('oval')
    (straight, arc, *_), bend = oval.lengths, oval.curvatures[1]
    later = Track((5.0, straight - 10.0, arc, straight, arc, 5.0), (0.0, 0.0, bend, 0.0, bend, 0.0))
    profile, shifted = (speed_profile(each, 30.0, 3.2, 2.0) for each in (oval, later))
    for s in np.linspace(0.0, oval.length, 200).tolist():
        assert shifted(0.0, s) == pytest.approx(profile(0.0, s + 5.0))


def test_a_profile_brakes_over_several_segments_and_an_open_track_has_free_ends() -> None:
    track = Track((10.0, 10.0, 10.0, pi * 6.0), (0.0, 0.0, 0.0, 1.0 / 6.0))
    profile = speed_profile(track, maximum=30.0, across=6.0, along=2.0)
    corner = 6.0
    for s in (0.0, 9.0, 15.0, 30.0):
        assert profile(0.0, s) == pytest.approx(sqrt(corner**2 + 4.0 * (30.0 - s)))
    assert profile(0.0, track.length) == pytest.approx(corner)

    reverse = speed_profile(Track(track.lengths[::-1], track.curvatures[::-1]), 30.0, 6.0, 2.0)
    for s in (0.0, 9.0, 15.0, 30.0):
        assert reverse(0.0, track.length - s) == pytest.approx(profile(0.0, s))


@pytest.mark.parametrize('kind', LAWS)
def test_gains_are_checked(kind: type[LaneLaw]) -> None:
    name, gain = next(iter(kind.gains.items()))
    with pytest.raises(UserError, match=f'{name}: -1 is not a number from'):
        kind(**{name: -1.0})
    with pytest.raises(UserError, match=f'kp: this controller has no such gain, but {name}'):
        kind(kp=1.0)
    assert getattr(kind(), name) == gain.default


def test_limits_of_a_profile_are_above_zero() -> None:
    with pytest.raises(UserError, match=r'across 0.0 must be a number above 0'):
        speed_profile(Track.named('L'), 6.0, 0.0, 1.0)


class Gained:
    """A law of a user's: gains, but no `reset`."""

    gains: ClassVar = {'k': Gain(0.5, 'rad/m', 'gain of the error across', 1.0)}
    terms = ('calls',)

    def __init__(self) -> None:
        self.k = 0.5
        self.calls = 0

    def steer_calculate(self, e_y: float, *_: object) -> float:
        """Return the angle [rad]."""
        self.calls += 1
        return -self.k * e_y


def situation(navigator: Navigator, x: float, y: float, psi: float, speed: float) -> Situation:
    """Return the situation of a car at a pose on the map."""
    measured = VehicleState(x, y, psi, speed, 0.0, 0.0)
    return navigator.situation(0.0, 0.02, measured, lambda _t, _s: 8.0)


def test_a_reset_begins_with_a_fresh_law_and_the_present_gains() -> None:
    navigator = Navigator(Track.named('oval'))
    keeping = LaneKeeping(as_pilot(PID()), as_lane_pilot(Gained()))
    keeping.set_gains({'lane.k': 0.1})
    beside = situation(navigator, 1.0, 0.5, 0.0, 5.0)
    assert [keeping.command(beside).servo for _ in range(2)] == [-0.05, -0.05]
    assert keeping.term('lane.calls') == 2

    keeping.reset()
    assert keeping.gain_values['lane.k'] == 0.1

    off = situation(navigator, 1.0, 20.0, 0.0, 5.0)
    assert keeping.command(off).servo == pytest.approx(-0.5)

    assert keeping.saturated
    assert keeping.term('lane.calls') == 1


def test_a_car_that_is_put_somewhere_else_is_found_again() -> None:
    track = Track.named('L')
    navigator = Navigator(track)
    for s in (0.0, 0.5, 120.0, 120.5, track.length - 0.1, track.length + 0.4, 60.0):
        _, place = situation(navigator, *track.place(s, 0.2), 5.0).on_track()
        assert place.s % track.length == pytest.approx(s % track.length)
        assert place.e_y == pytest.approx(0.2)


def test_a_profile_of_speed_is_pickled() -> None:
    """To sweep in other processes, for example."""
    for track in (Track.named('L'), Track((40.0, 30.0), (0.0, 0.05))):
        profile = speed_profile(track, 12.0, 3.0, 2.0)
        again = pickle.loads(pickle.dumps(profile))  # noqa: S301 (our own)
        for s in (0.0, 17.3, 42.0, 66.6):
            assert again(0.0, s) == profile(0.0, s)
