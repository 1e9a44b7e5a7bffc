"""Which command holds, whether it is the answer, and when it counts as lost."""

from __future__ import annotations

import pytest

from barc_sim.simulation.commands import Commands
from barc_sim.vehicle.bike_model import Command

GO, STOP = Command(motor=1.0), Command(motor=-1.0)


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


def test_a_command_without_a_stamp_is_usable_at_any_time() -> None:
    commands = Commands()
    commands.store(GO, stamp=20, present=20, t=0.0)
    assert commands.store(STOP, stamp=0, present=20, t=0.0)


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
