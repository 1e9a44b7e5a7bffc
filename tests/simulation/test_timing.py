"""Deadlines by the wall clock; and which command holds, whether it answers, when it is lost."""

from __future__ import annotations

import pytest

from barc_sim.simulation.timing import PUNCTUAL, Commands, Pace
from barc_sim.vehicle.bike_model import Command

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


def test_whole_periods_that_were_lost_are_counted_and_given_up(pace: Pace) -> None:
    assert not pace.pass_deadline(100.071)  # due at 100.02, 2.55 periods ago
    assert pace.slipped == 2
    assert pace.pass_deadline(100.0805)
    assert pace.slipped == 2


def test_a_command_answers_the_state_of_its_stamp_only() -> None:
    commands = Commands()
    assert commands.store(GO, stamp=10, present=20, t=0.0)
    assert (commands.latest, commands.answered) == (GO, False)
    commands.store(STOP, stamp=20, present=20, t=0.0)
    assert (commands.latest, commands.answered) == (STOP, True)
    commands.next_step()
    assert (commands.latest, commands.answered) == (STOP, False)


def test_a_command_without_a_stamp_answers_every_state_until_one_with_a_stamp_comes() -> None:
    commands = Commands()
    commands.store(GO, stamp=0, present=20, t=0.0)
    commands.next_step()
    assert commands.answered
    commands.store(GO, stamp=20, present=20, t=0.0)
    commands.next_step()
    assert not commands.answered


def test_a_command_that_is_older_than_the_one_that_holds_is_not_usable() -> None:
    commands = Commands()
    commands.store(GO, stamp=20, present=20, t=0.0)
    commands.next_step()
    assert not commands.store(STOP, stamp=10, present=40, t=0.0)
    assert commands.latest == GO
    assert commands.store(STOP, stamp=20, present=40, t=0.0)  # late, but the newest
    assert commands.store(STOP, stamp=40, present=40, t=0.0)


@pytest.mark.parametrize('stamp', [-5, 10, 19, 21, 10**18])
def test_what_came_before_it_or_comes_after_it_cannot_keep_the_answer_out(stamp: int) -> None:
    commands = Commands()
    commands.store(STOP, stamp=20, present=20, t=0.0)
    assert not commands.store(GO, stamp, present=20, t=0.0)
    assert commands.latest == STOP
    commands = Commands()
    commands.store(STOP, stamp, present=20, t=0.0)
    assert commands.store(GO, stamp=20, present=20, t=0.0)
    assert (commands.latest, commands.answered) == (GO, True)


def test_what_answers_no_state_makes_none_due_where_commands_come_as_they_please() -> None:
    commands = Commands()
    commands.store(GO, stamp=0, present=20, t=0.0)
    commands.store(STOP, stamp=99, present=20, t=0.0)
    commands.next_step()
    assert (commands.latest, commands.answered) == (STOP, True)


def test_silence_beyond_the_timeout_is_a_loss_until_the_next_command() -> None:
    commands = Commands(timeout=0.5)
    commands.start_timeout(5.0)
    assert not commands.timed_out(5.5)
    assert commands.timed_out(5.6)
    commands.store(GO, stamp=0, present=20, t=6.0)
    assert not commands.timed_out(6.5)
    commands.start_timeout(5.0)
    assert not commands.timed_out(6.5)
    assert commands.timed_out(6.51)
