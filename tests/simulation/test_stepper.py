"""The state machine of a simulator, its deadlines and commands."""

# ruff: noqa: D102 (the table that is tested says what each event is)

from __future__ import annotations

from math import cos, inf, nan
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from barc_sim.interfaces.records import Command
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import (
    PUNCTUAL,
    Commands,
    Pace,
    Phase,
    Stepper,
    StepperOptions,
    parameters,
)
from barc_sim.vehicle.bike_model import BicycleState
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.plant import Observation


GO, STOP = Command(motor=1.0), Command(motor=-1.0)


@pytest.fixture
def pace() -> Pace:
    pace = Pace(0.02)
    pace.begin(100.0)
    return pace


def test_deadlines_are_a_period_apart_however_early_or_late_each_is_noticed(pace: Pace) -> None:
    assert pace.pass_deadline(100.0199)
    assert pace.pass_deadline(100.04 + 0.99 * PUNCTUAL * 0.02)
    assert not pace.pass_deadline(100.06 + 1.01 * PUNCTUAL * 0.02)
    assert pace.slipped == 0


def test_a_command_without_a_stamp_answers_every_state_until_one_with_a_stamp_comes() -> None:
    commands = Commands()
    commands.store(GO, stamp=0, present=20, t=0.0)
    commands.next_step()
    assert commands.answered
    commands.store(GO, stamp=20, present=20, t=0.0)
    commands.next_step()
    assert not commands.answered


@pytest.mark.parametrize('stamp', [-5, 10, 19, 21, 10**18])
def test_the_answer_to_a_state_is_used_in_any_order_with_other_commands(stamp: int) -> None:
    commands = Commands()
    commands.store(STOP, stamp=20, present=20, t=0.0)
    assert not commands.store(GO, stamp, present=20, t=0.0)
    assert commands.latest == STOP
    commands = Commands()
    commands.store(STOP, stamp, present=20, t=0.0)
    assert commands.store(GO, stamp=20, present=20, t=0.0)
    assert (commands.latest, commands.answered) == (GO, True)


def test_unstamped_and_late_commands_do_not_mix_up_unsynchronised_steps() -> None:
    commands = Commands()
    commands.store(GO, stamp=0, present=20, t=0.0)
    commands.store(STOP, stamp=99, present=20, t=0.0)
    commands.next_step()
    assert (commands.latest, commands.answered) == (STOP, True)


START = 10**18  #: [ns]
PERIOD = 20_000_000  #: [ns]
LATE = 0.015  #: [s] of a period of 0.02


class Engine:
    """A stepper with a clock that stands still, and all that it calls."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 (of any parameter)
        self.now = 100.0
        self.wall = START
        self.published: list[tuple[float, Observation, int]] = []
        self.applied: list[tuple[Command, int, bool]] = []  #: with the state's stamp; missed
        self.deadlines = False
        self.starts = self.ends = 0
        self.warnings: list[str] = []
        self.limited: list[str] = []  #: what each warning is about
        self.log: list[str] = []
        self.late: list[tuple[Command, int]] = []  #: commands that are delivered on request only
        self.values = {row.name: row.default for row in parameters()} | settings
        pace = {name: self.values[name] for name in StepperOptions._fields}
        self.stepper = Stepper(
            Scenario.of_parameters(self.values, road=Road.flat()),
            StepperOptions(**pace),
            self,
            clock=lambda: self.now,
            wall_clock=lambda: self.wall,
        )

    def publish_state(self, t: float, observation: Observation, stamp_ns: int) -> None:
        self.published.append((t, observation, stamp_ns))

    def publish_applied(self, command: Command, stamp_ns: int, *, missed: bool) -> None:
        self.applied.append((command, stamp_ns, missed))

    def run_deadlines(self, *, on: bool) -> None:
        self.deadlines = on

    def defer_decision(self) -> None:
        while self.late:
            self.stepper.take_command(*self.late.pop(0))
        self.stepper.decide()

    def prepare_start(self, reason: str) -> None:
        self.log.append(reason)
        self.starts += 1

    def finish(self) -> None:
        self.ends += 1

    def warn(self, sentence: Callable[[], str], about: str) -> None:
        self.warnings.append(sentence().partition(':')[0])
        self.limited.append(about)

    @property
    def stamp(self) -> int:
        return self.published[-1][2]

    @property
    def speed(self) -> float:
        return self.published[-1][1].true.v_x

    def answer(self, motor: float = 1.0) -> None:
        """Answer the present state."""
        assert self.stepper.take_command(Command(motor), self.stamp) is None

    def deadline(self, late: float = 0.0) -> None:
        """Let the next deadline pass, `late` [s]."""
        self.now += 0.02 + late
        self.stepper.pass_deadline()
        self.now -= late


def started(**settings: Any) -> Engine:  # noqa: ANN401 (as above)
    engine = Engine(**settings)
    engine.stepper.start()
    return engine


def lock_step(**settings: Any) -> Engine:  # noqa: ANN401 (as above)
    return started(realtime_factor=0.0, **settings)


# Starting


def test_nothing_is_published_before_the_start() -> None:
    engine = Engine()
    engine.stepper.take_command(Command(1.0), 0)
    engine.stepper.pass_deadline()
    engine.stepper.check()
    assert engine.stepper.phase is Phase.STARTING
    assert engine.stepper.single_step() == (False, 'not begun yet')
    assert not engine.published


def test_start_while_paused_publishes_the_first_state_and_stays_paused() -> None:
    engine = Engine()
    assert engine.stepper.pause(on=True)
    assert engine.stepper.phase is Phase.STARTING
    engine.stepper.start()
    assert engine.stepper.phase is Phase.PAUSED
    assert engine.stepper.states == 1
    assert not engine.deadlines


# Running


def test_lock_step_steps_on_the_answer_to_the_present_state_only() -> None:
    engine = lock_step()
    for stamp in (START - PERIOD, START - 1, START + PERIOD):
        engine.stepper.take_command(Command(5.0), stamp)
        assert engine.stepper.states == 1
    engine.answer(1.0)
    assert engine.stepper.states == 2
    assert engine.speed == pytest.approx(0.02, rel=1e-3)
    assert engine.stamp == START + PERIOD


def test_missed_command_is_counted_and_the_last_one_holds() -> None:
    engine = started()
    engine.answer(1.0)
    engine.deadline()
    engine.deadline()
    assert engine.stepper.states == 3
    assert engine.speed == pytest.approx(0.04, rel=1e-3)
    assert engine.stepper.missed == 1
    assert engine.warnings == engine.limited == ['missed deadlines']

    applied = [(GO, START, False), (GO, START + PERIOD, True)]
    assert engine.applied == applied


@pytest.mark.parametrize('factor', [0.0, 1.0])
def test_commands_stamped_with_the_clock_are_warned_of_once_with_the_cause(factor: float) -> None:
    engine = started(realtime_factor=factor)
    for offset in (500_000_000, 7):
        engine.stepper.take_command(Command(1.0), engine.stamp + offset)
        engine.deadline()
    first, *others = engine.warnings
    assert first == ('commands arrive stamped +0.5 s from the state')
    assert not [each for each in others if each.startswith('commands')]


def test_late_answers_and_those_from_before_a_reset_are_not_of_another_clock() -> None:
    engine = started()
    first = engine.stamp
    engine.answer()
    engine.deadline()
    engine.stepper.take_command(Command(1.0), first)
    engine.answer()
    engine.wall += 1_234_567_891
    assert engine.stepper.reset()

    engine.stepper.start()
    engine.stepper.take_command(Command(1.0), first)
    engine.stepper.take_command(Command(1.0), 0)
    assert engine.stamp > first
    assert not engine.warnings


def test_late_deadline_slips_and_the_state_can_still_be_answered() -> None:
    engine = started()
    engine.deadline(LATE)
    assert (engine.stepper.states, engine.stepper.missed, engine.stepper.slipped) == (1, 0, 1)
    assert not engine.warnings
    engine.answer(1.0)
    engine.deadline()
    assert (engine.stepper.states, engine.stepper.missed, engine.stepper.slipped) == (2, 0, 1)


def test_late_deadline_of_an_answered_state_is_a_step_and_no_slip() -> None:
    engine = started()
    engine.answer()
    engine.deadline(LATE)
    assert (engine.stepper.states, engine.stepper.missed, engine.stepper.slipped) == (2, 0, 0)


def test_whole_periods_that_were_lost_are_counted() -> None:
    engine = started()
    engine.answer()
    engine.now += 0.05
    engine.deadline()
    assert engine.stepper.slipped == 2
    assert [stamp for *_, stamp in engine.published] == [START, START + PERIOD]


def test_answer_that_waits_for_its_delivery_is_not_missed() -> None:
    engine = started()
    engine.late.append((Command(1.0), START))
    engine.deadline()
    assert (engine.stepper.states, engine.stepper.missed) == (2, 0)
    assert engine.speed > 0.0


@pytest.mark.parametrize(
    'command', [Command(nan), Command(-inf), Command(0.0, nan), Command(101.0), Command(1.0, -1.6)]
)
def test_command_that_is_not_finite_or_out_of_range_is_refused(command: Command) -> None:
    engine = lock_step()
    reason = engine.stepper.take_command(command, START)
    assert reason == (
        f'a command beyond ±100 m/s² or ±1.5 rad: {float(command.motor)}, {float(command.servo)}'
    )
    assert engine.stepper.states == 1


def test_command_out_of_order_is_refused() -> None:
    engine = lock_step()
    engine.answer()
    engine.answer()
    assert engine.stepper.take_command(Command(1.0), START) == (
        'a command stamped -0.04 s from the present state: a newer one or its answer holds'
    )


def test_run_ends_with_the_answer_to_the_first_state_beyond_the_distance() -> None:
    engine = lock_step(distance=0.001)
    while engine.stepper.phase is Phase.RUNNING:
        engine.answer(8.0)
    assert engine.stepper.phase is Phase.FINISHED
    assert engine.ends == 1

    xs = [observation.true.x for _, observation, _ in engine.published]
    assert xs[-2] < 0.001 <= xs[-1]

    engine.stepper.take_command(Command(8.0), 0)
    engine.stepper.pass_deadline()
    assert engine.stepper.single_step() == (False, 'the run has ended')
    assert engine.stepper.states == len(xs)

    engine.stepper.reset()
    assert (engine.stepper.phase, engine.stepper.laps) == (Phase.STARTING, 0)


@pytest.mark.parametrize('reset_first', [False, True])
def test_lap_begins_as_after_a_reset_and_the_last_ends_the_run(reset_first: bool) -> None:
    engine = lock_step(distance=0.5, laps=2)
    starts = engine.starts
    if reset_first:  # a lap that is cut short does not count
        engine.answer(8.0)
        engine.stepper.reset()
        engine.answer(8.0)
        engine.stepper.start()
        assert (engine.stepper.laps, engine.log) == (0, ['reset: the car is back at the start'])
    first = len(engine.published) - 1
    while engine.stepper.phase is Phase.RUNNING:
        engine.answer(8.0)
    assert (engine.stepper.phase, engine.ends) == (Phase.STARTING, 0)
    assert engine.starts == starts + 1 + reset_first
    assert engine.log[-1] == 'lap 1 is finished: the next one begins'

    second = len(engine.published)
    engine.stepper.start()
    while engine.stepper.phase is Phase.RUNNING:
        engine.answer(8.0)
    assert (engine.stepper.phase, engine.ends, engine.stepper.laps) == (Phase.FINISHED, 1, 2)

    lap, next_lap = engine.published[first:second], engine.published[second:]
    assert [(t, observation) for t, observation, _ in lap] == [
        (t, observation) for t, observation, _ in next_lap
    ]

    stamps = [stamp for *_, stamp in engine.published]
    assert stamps == [START + k * PERIOD for k in range(len(stamps))]


def test_laps_follow_until_the_run_is_stopped() -> None:
    engine = lock_step(distance=0.001, laps=0)
    for _ in range(5):
        while engine.stepper.phase is Phase.RUNNING:
            engine.answer(8.0)
        assert engine.stepper.phase is Phase.STARTING
        engine.stepper.start()


def test_change_of_the_plant_takes_effect_with_the_next_step() -> None:
    engine = lock_step()
    slow = engine.values | {'motor_delay': 2 * PERIOD / 1e9}
    engine.stepper.retune(Scenario.of_parameters(slow, road=Road.flat()))
    for _ in range(4):
        engine.answer(5.0)
    speeds = [observation.true.v_x for _, observation, _ in engine.published]
    assert speeds[:3] == [0.0, 0.0, 0.0]
    assert 0.0 < speeds[3] < speeds[4]


def test_change_of_the_plant_lasts_over_a_reset() -> None:
    engine = lock_step()
    weak = engine.values | {'motor_limit': 1.0}
    engine.stepper.retune(Scenario.of_parameters(weak, road=Road.flat()))
    engine.answer(5.0)
    engine.stepper.reset()
    engine.answer(5.0)
    engine.stepper.start()
    engine.answer(5.0)

    assert engine.speed == pytest.approx(1.0 * PERIOD / 1e9, rel=1e-3)


def test_no_command_turns_the_wheels_beyond_a_right_angle() -> None:
    (bounds,) = (each.between for each in parameters() if each.name == 'refuse_servo_above')
    assert bounds[0] == 0.0 < cos(bounds[1])


def test_car_without_commands_brakes_after_the_timeout() -> None:
    engine = started(command_timeout=0.5)
    engine.deadline()
    assert not engine.warnings  # the timeout counts from the start

    engine.stepper.take_command(Command(4.0), 0)
    for _ in range(25):
        engine.deadline()
    top = engine.speed
    assert not engine.warnings

    for _ in range(200):
        engine.deadline()
    assert engine.warnings[0] == 'no command for 0.5 s'
    assert top > 1.5
    assert engine.speed == pytest.approx(0.0, abs=1e-9)
    assert engine.stepper.missed == 0

    engine.stepper.take_command(Command(4.0), 0)
    engine.deadline()
    assert engine.speed > 0.0


# Paused


@pytest.mark.parametrize('factor', [0.0, 1.0])
def test_time_stands_still_while_paused(factor: float) -> None:
    engine = started(realtime_factor=factor)
    assert engine.stepper.pause(on=True)
    assert not engine.stepper.pause(on=True)
    assert not engine.deadlines

    engine.answer()
    engine.stepper.pass_deadline()
    assert engine.stepper.phase is Phase.PAUSED
    assert engine.stepper.states == 1
    assert engine.stepper.pause(on=False)
    assert engine.stepper.phase is Phase.RUNNING
    assert engine.stepper.states == (1 if factor else 2)  # lock-step: the answer is there
    assert engine.deadlines == bool(factor)


def test_a_pause_counts_as_no_missed_deadline_or_slip() -> None:
    engine = started()
    engine.stepper.pause(on=True)
    engine.now += 100.0
    engine.stepper.pause(on=False)
    engine.answer()
    engine.deadline()
    assert (engine.stepper.states, engine.stepper.missed, engine.stepper.slipped) == (2, 0, 0)


def test_a_pause_leaves_stamps_behind_until_a_reset() -> None:
    engine = started()
    engine.stepper.pause(on=True)
    engine.wall += 6 * 10**9
    engine.stepper.pause(on=False)
    engine.answer()
    engine.wall += PERIOD
    engine.deadline()
    assert engine.stepper.stamp_lag == 6.0

    engine.answer()
    engine.stepper.reset()
    engine.stepper.start()
    assert (engine.stamp, engine.stepper.stamp_lag) == (engine.wall, 0.0)


@pytest.mark.parametrize('factor', [0.0, 0.5, 4.0])
def test_stamps_at_another_pace_do_not_depend_on_the_wall_clock(factor: float) -> None:
    engine = started(realtime_factor=factor)
    engine.wall += 10**10
    engine.answer()
    if factor:
        engine.deadline()
        engine.answer()
    engine.stepper.reset()
    before = engine.stamp
    engine.stepper.start()

    assert engine.stamp == before + PERIOD
    assert (engine.stepper.stamp_lag, engine.warnings) == (0.0, [])


def test_single_step_while_paused() -> None:
    engine = started()
    engine.stepper.pause(on=True)
    engine.answer()
    assert engine.stepper.single_step() == (True, 'state 1')
    assert engine.stepper.single_step() == (True, 'state 1 is not answered yet: the step follows')
    assert engine.stepper.states == 2

    engine.answer()
    assert engine.stepper.states == 3

    engine.answer()
    assert engine.stepper.states == 3
    assert engine.stepper.phase is Phase.PAUSED


def test_step_that_was_not_taken_is_forgotten_when_time_runs_again() -> None:
    engine = started()
    engine.stepper.pause(on=True)
    engine.stepper.single_step()
    engine.stepper.pause(on=False)
    engine.answer()
    assert engine.stepper.states == 1


# Reset


@pytest.mark.parametrize('factor', [0.0, 1.0])
def test_reset_of_an_answered_state_starts_again_with_later_stamps(factor: float) -> None:
    engine = started(realtime_factor=factor)
    for _ in range(5):
        engine.answer()
        engine.deadline()
    if not factor:
        engine.stepper.pause(on=True)  # an answered state stays
    engine.answer()
    before = engine.stamp
    engine.stepper.reset()
    assert engine.stepper.phase is Phase.STARTING
    assert engine.starts == 1
    assert not engine.deadlines

    engine.stepper.pause(on=False)
    engine.stepper.start()
    t, observation, stamp = engine.published[-1]
    assert (t, observation.true.x, stamp) == (0.0, 0.0, before + PERIOD)
    assert engine.stepper.states == 7


@pytest.mark.parametrize('how', ['answer', 'deadline', 'late deadline', 'delivery', 'check'])
def test_reset_of_a_state_that_is_not_answered_waits(how: str) -> None:
    engine = started()
    engine.stepper.reset()
    assert engine.stepper.phase is Phase.RUNNING

    if how == 'answer':
        engine.answer()
    elif how == 'deadline':
        engine.deadline()
    elif how == 'late deadline':
        engine.deadline(LATE)
        assert engine.stepper.phase is Phase.RUNNING
        engine.deadline()
    elif how == 'delivery':
        engine.late.append((Command(1.0), START))
        engine.deadline()
    else:
        engine.stepper.check()
    assert engine.stepper.phase is Phase.STARTING
    assert engine.stepper.states == engine.starts == 1

    engine.stepper.start()


# Initial pose


def test_an_initial_pose_is_the_start_of_the_run_that_follows() -> None:
    engine = lock_step(distance=20.0)
    for _ in range(5):
        engine.answer(8.0)
    place = BicycleState(x=-3.0, y=1.0, psi=0.1)
    assert engine.stepper.place(place) is None
    assert engine.stepper.phase is Phase.RUNNING
    engine.answer(8.0)
    assert (engine.stepper.phase, engine.starts) == (Phase.STARTING, 1)
    assert engine.log == ['reset: the car is at x -3.00 m, y 1.00 m']

    engine.stepper.start()
    first = len(engine.published) - 1
    plant = Plant(road=Road.flat())
    plant.place(place)
    for _ in range(10):
        t, observation, stamp = engine.published[-1]
        k = len(engine.published) - 1
        assert (t, stamp) == (pytest.approx((k - first) * 0.02), START + k * PERIOD)
        assert observation == plant.observe()
        engine.answer(2.0)
        plant.advance(Command(2.0))

    engine.stepper.reset()
    engine.answer()
    engine.stepper.start()
    assert engine.published[-1][1].true.x == 0.0  # where the run had begun


def test_an_initial_pose_on_a_track_is_measured_from_the_nearest_place() -> None:
    engine = lock_step(track='oval', laps=2)
    track = Track.named('oval')
    x, y, psi = track.place(12.0, 0.5, 0.1)
    engine.answer()
    assert engine.stepper.place(BicycleState(x, y, psi)) is None

    engine.answer()
    engine.stepper.start()
    place = engine.published[-1][1].on_track
    assert place
    assert (place.s, place.e_y, place.e_psi) == pytest.approx((12.0, 0.5, 0.1))
    assert (place.lap, place.lap_time) == (0, 0.0)


@pytest.mark.parametrize(
    ('settings', 'state', 'sentence'),
    [
        (
            {},
            BicycleState(x=nan),
            'an initial pose at x nan m, y 0 m, heading 0 rad: expected at most',
        ),
        ({}, BicycleState(y=-inf), 'an initial pose at x 0 m, y -inf m'),
        ({}, BicycleState(psi=nan), 'an initial pose at x 0 m, y 0 m, heading nan rad'),
        ({}, BicycleState(x=2e6), 'an initial pose at x 2e+06 m'),
        (
            {'track': 'oval'},
            BicycleState(y=-4.0),
            'an initial pose 4.00 m from the centre line: expected',
        ),
    ],
)
def test_an_initial_pose_where_no_car_can_be_is_refused(
    settings: dict[str, Any], state: BicycleState, sentence: str
) -> None:
    engine = lock_step(**settings)
    refusal = engine.stepper.place(state)
    assert refusal
    assert refusal.startswith(sentence)
    engine.answer()
    assert (engine.stepper.phase, engine.stepper.states) == (Phase.RUNNING, 2)


# Whatever comes


class AnyEvents(RuleBasedStateMachine):
    """Events in any order: stamps a period apart, no step without a reason, deadlines in time."""

    def __init__(self) -> None:
        super().__init__()
        self.engine = Engine(distance=0.5)
        self.stepper = self.engine.stepper

    @precondition(lambda self: self.stepper.phase is Phase.STARTING)
    @rule()
    def start(self) -> None:
        self.stepper.start()

    @rule(motor=st.floats(-8.0, 8.0), age=st.integers(-3, 3))
    def command(self, motor: float, age: int) -> None:
        stamp = (self.engine.stamp if self.engine.published else START) + age * PERIOD
        self.stepper.take_command(Command(motor), stamp)

    @precondition(lambda self: self.engine.deadlines)
    @rule(late=st.floats(0.0, 0.1))
    def deadline(self, late: float) -> None:
        before = self.stepper.states, self.stepper.missed, self.stepper.slipped
        self.engine.deadline(late)
        steps, missed, slipped = self.stepper.states, self.stepper.missed, self.stepper.slipped
        assert steps - before[0] in {0, 1}
        assert missed - before[1] <= (slipped == before[2])

    @rule(on=st.booleans())
    def pause(self, on: bool) -> None:
        self.stepper.pause(on=on)

    @rule()
    def single_step(self) -> None:
        before = self.stepper.states
        is_taken, _ = self.stepper.single_step()
        assert self.stepper.states <= before + is_taken

    @rule()
    def reset(self) -> None:
        self.stepper.reset()

    @rule(x=st.floats(-1.0, 1.0))
    def place(self, x: float) -> None:
        assert self.stepper.place(BicycleState(x=x)) is None

    @rule()
    def check(self) -> None:
        self.stepper.check()

    @invariant()
    def holds(self) -> None:
        assert self.engine.deadlines == (self.stepper.phase is Phase.RUNNING)
        if self.stepper.phase in {Phase.RUNNING, Phase.PAUSED}:
            assert self.stepper.paused == (self.stepper.phase is Phase.PAUSED)
        stamps = [stamp for *_, stamp in self.engine.published]
        assert stamps == [START + k * PERIOD for k in range(len(stamps))]
        assert len(stamps) == self.stepper.states
        # What acts is recorded once for each state, and so is each missed command.
        applied = [stamp for _, stamp, _ in self.engine.applied]
        assert applied == sorted({*applied} & {*stamps})
        assert sum(missed for *_, missed in self.engine.applied) == self.stepper.missed


TestAnyEvents = AnyEvents.TestCase
TestAnyEvents.settings = settings(max_examples=30, deadline=None)
