"""Pilots: each says by its type what it decides, and drives a run and a node alike."""

from __future__ import annotations

from math import isnan
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.lane import LaneLQR
from barc_sim.control.mpc import SpeedMPC
from barc_sim.control.pilots import (
    LaneKeeping,
    LanePilot,
    Pilot,
    PlanPilot,
    SpeedPilot,
    StraightAhead,
    as_lane_pilot,
    as_pilot,
)
from barc_sim.control.situation import Situation
from barc_sim.control.speed import LQR, PID, Gain
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.simulation.closed_loop import closed_loop, lap, simulate
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from barc_sim.control.lane import Curvature
    from barc_sim.interfaces.parameters import ParameterDeclaration

TRACK = Track.named('oval')
AT_REST = VehicleState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Schedule(Pilot):
    """Commands over time, of a car that holds no speed."""

    terms: ClassVar = {'seconds': 'the time'}

    def __init__(self) -> None:
        self.seen: list[Situation] = []

    @property
    def follows_reference(self) -> bool:
        """Whether it holds a speed."""
        return False

    def reset(self) -> None:
        """Begin anew."""
        self.seen = []

    def command(self, situation: Situation) -> Command:
        """Accelerate for two seconds."""
        self.seen.append(situation)
        return Command(1.0 if situation.t < 2.0 else 0.0, 0.0)

    def term(self, name: str) -> float:
        """Return the time."""
        return self.seen[-1].t if name == 'seconds' else float('nan')


class Planned:
    """A steering law of a user's with a speed of its own."""

    acceleration = 0.0
    prediction = np.zeros((3, 2))

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the angle [rad], and choose the acceleration."""
        self.acceleration = 2.0 * (4.0 - speed)
        self.prediction = np.array([[0.0, e_y], [1.0, e_y], [2.0, e_y]])
        return 3.0 * curvature(0.0) - 0.2 * e_y - 0.6 * e_psi


def answered(controller: object, lane: object = None, track: Track | None = None) -> CruiseControl:
    """Return the node's control of these pilots."""

    def declare(parameters: list[ParameterDeclaration]) -> dict[str, Any]:
        return {each.name: each.default for each in parameters}

    def never(reason: Any) -> None:  # noqa: ANN401
        raise AssertionError(reason())

    return CruiseControl(controller, declare, 8.0, never, never, track, lane)


@pytest.mark.parametrize(
    ('law', 'kind'),
    [
        (None, StraightAhead),
        (LaneLQR(), LanePilot),
        (SpeedMPC, PlanPilot),
        (Planned(), PlanPilot),
        (LanePilot(LaneLQR()), LanePilot),
    ],
)
def test_a_law_that_plans_the_speed_becomes_another_pilot_than_one_that_only_steers(
    law: object, kind: type[Pilot]
) -> None:
    if law is SpeedMPC:
        pytest.importorskip('daqp')
        law = SpeedMPC()
    pilot = as_lane_pilot(law)
    assert type(pilot) is kind
    assert pilot.plans_speed == (kind is PlanPilot)
    keeping = LaneKeeping(as_pilot(PID()), pilot)
    assert keeping.follows_reference != keeping.plans_speed


def test_a_law_that_plans_the_speed_replaces_the_acceleration_and_has_no_reference() -> None:
    log = lap(Planned(), 'oval', laps=1)
    assert np.abs(log.v_x[log.t > 5.0] - 4.0).max() < 0.1
    assert np.isnan(log.reference).all()
    assert not np.isnan(log.proportional).any()  # the PID's, which is asked all the same

    control = answered(None, Planned(), TRACK)
    assert control.makes_plans
    answer = control.take_state(0, AT_REST._replace(x=5.0, y=0.5))
    assert answer is not None
    assert answer.motor == 8.0
    assert isnan(control.computed()['reference'])
    assert control.predicted().x == pytest.approx([5.0, 6.0, 7.0])
    assert control.predicted().y == pytest.approx([0.5, 0.5, 0.5])


def test_commands_over_time_act_at_the_same_states_with_and_without_ros() -> None:
    pilot = Schedule()
    log = simulate(controller=pilot, distance=0.0, max_duration=3.0, road='flat')
    assert log.motor.tolist() == [1.0] * 100 + [0.0] * 51
    assert np.isnan(log.reference).all()
    assert log.terms['seconds'].tolist() == log.t.tolist()
    assert pilot.seen[1].measured.v_x == log.v_x[1]
    assert pilot.seen[1].gap is None

    control = answered(Schedule())
    stamps = range(10**18, 10**18 + 151 * 20_000_000, 20_000_000)
    answers = [control.take_state(stamp, AT_REST) for stamp in stamps]
    assert [each.motor for each in answers if each] == log.motor.tolist()
    facts = control.computed()
    assert isnan(facts['reference'])
    assert (facts['names'], facts['values']) == (['seconds'], [3.0])


def test_node_and_closed_loop_ask_a_pilot_for_the_same_situations() -> None:
    class Watching(Schedule):
        @property
        def plans_speed(self) -> bool:
            return True

    without, with_node = Watching(), Watching()
    plant = Plant(track=TRACK)
    log = closed_loop(plant, lane=without, distance=20.0, max_duration=4.0)
    control = answered(None, with_node, TRACK)
    for k, situation in enumerate(without.seen):
        control.take_state(k * plant.period_ns, situation.measured)
    assert len(log) == len(without.seen) > 100
    assert with_node.seen == without.seen
    assert all(each.place for each in without.seen)


def test_gains_of_both_pilots_are_set_by_name() -> None:
    keeping = LaneKeeping(as_pilot(LQR()), as_lane_pilot(LaneLQR()))
    keeping.set_gains({'speed_weight': 100.0, 'lane.preview': 0.5})
    values = keeping.gain_values

    assert values.keys() == keeping.gains.keys()
    assert (values['speed_weight'], values['lane.preview']) == (100.0, 0.5)
    with pytest.raises(UserError, match='preview: 99 is not a number from 0 to 10'):
        keeping.set_gains({'lane.preview': 99.0})
    with pytest.raises(UserError, match='kp: this controller has no such gain'):
        keeping.set_gains({'kp': 1.0})
    with pytest.raises(UserError, match='kp: this pilot has no gains'):
        Schedule().set_gains({'kp': 1.0})


def test_gains_beyond_their_limits_are_refused_where_an_object_becomes_a_pilot() -> None:
    class Own:
        gains: ClassVar = {'gain': Gain(2.0, '1/s', 'the gain', 10.0, (0.0, 5.0))}
        gain = 6.0

        def acc_calculate(self, reference: float, current: float) -> float:
            return self.gain * (reference - current)

    with pytest.raises(UserError, match='gain: 6 is not a number from 0 to 5'):
        simulate(controller=Own())


def test_a_pilot_that_steers_needs_a_track() -> None:
    with pytest.raises(UserError, match='steers along a track'):
        simulate(controller=as_lane_pilot(LaneLQR()))


@pytest.mark.parametrize('wrong', [LaneLQR, 3.0, PID()])
def test_a_law_without_steer_calculate_is_refused(wrong: Any) -> None:  # noqa: ANN401
    for use in (as_lane_pilot, lambda lane: lap(lane, laps=1)):
        with pytest.raises(UserError, match=r'must be an object with a method steer_calculate\('):
            use(wrong)


def test_a_pilot_of_the_speed_is_limited() -> None:
    pilot = as_pilot(PID(10.0, 0.0, 0.0))
    pilot.limit(3.0)
    assert pilot.command(Situation(0.0, 0.02, AT_REST, 8.0)) == (3.0, 0.0)
    assert pilot.saturated
    assert isinstance(pilot, SpeedPilot)
    assert [*pilot.values()] == [80.0, 0.0, 0.0]
